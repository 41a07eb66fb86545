#include "section7.h"

static void example(SOCKET g)
{
    /* Set the trapezoidal end position of motors 5, 6, and 7 to -85 */
    set(g, "567", TRAP_END_POSITION, -85);
}

static int holds(SOCKET g)
{
    return value(g, "5", TRAP_END_POSITION) == -85 && value(g, "6", TRAP_END_POSITION) == -85 &&
           value(g, "7", TRAP_END_POSITION) == -85 && value(g, "1", TRAP_END_POSITION) == 0;
}

START(AWAKE)
