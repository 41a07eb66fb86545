#include "section7.h"

static void example(SOCKET g)
{
    /* Get the temperature of motor controllers 5, 6, and 7 */
    get(g, "567", MOTOR_TEMPERATURE);
}

static int holds(SOCKET g)
{
    (void)g;
    /* Tenths of a degree C. */
    return propertyList[5][MOTOR_TEMPERATURE] > 100 && propertyList[6][MOTOR_TEMPERATURE] > 100 &&
           propertyList[7][MOTOR_TEMPERATURE] > 100 && propertyList[4][MOTOR_TEMPERATURE] == 0;
}

START(AWAKE)
