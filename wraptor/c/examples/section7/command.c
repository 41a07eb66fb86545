#include "section7.h"

static void example(SOCKET g)
{
    /* Set motor 7's Max Torque Limit to 550 */
    command(g, "7 S MT 550");
}

static int holds(SOCKET g)
{
    command(g, "4 S E 82");
    command(g, "4 S M 5");
    /* Its move is over. */
    return value(g, "7", WRAPTOR_PROPERTY_MT) == 550 && value(g, "4", CONTROL_MODE) == MODE_PID && is_at(g, "4", 82);
}

START(AWAKE)
