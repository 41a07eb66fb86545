#include "section7.h"

static void example(SOCKET g)
{
    set(g, "7", WRAPTOR_PROPERTY_MT, 550);
    set(g, "1234567", CONTROL_MODE, MODE_IDLE);
    /* Save the Wraptor parameters, prepare for power-off */
    saveParameters(g, "1234567");
}

static int holds(SOCKET g)
{
    /* What is stored comes back. */
    set(g, "7", WRAPTOR_PROPERTY_MT, 600);
    set(g, "7", WRAPTOR_PROPERTY_LOAD, WRAPTOR_PROPERTY_MT);
    return value(g, "7", WRAPTOR_PROPERTY_MT) == 550;
}

START(AT_ZERO)
