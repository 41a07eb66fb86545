#include "section7.h"

static void example(SOCKET g)
{
    set(g, "567", TRAP_END_POSITION, 50);
    set(g, "567", CONTROL_MODE, MODE_TRAPEZOIDAL);
    /* Wait for the Control Mode to be MODE_PID */
    waitFor(g, "567", CONTROL_MODE, MODE_PID);
}

static int holds(SOCKET g)
{
    return is_at(g, "5", 50) && is_at(g, "6", 50) && is_at(g, "7", 50) && propertyList[6][CONTROL_MODE] == MODE_PID;
}

START(AT_ZERO)
