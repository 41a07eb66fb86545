#include "section7.h"

static void example(SOCKET g)
{
    /* Only a motor that holds its position after a move goes to MODE_PID. */
    set(g, "567", WRAPTOR_PROPERTY_HOLD, 1);
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
