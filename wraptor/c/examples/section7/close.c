#include "section7.h"

static void example(SOCKET g)
{
    /* Close fingers 1 and 3 */
    close(g, "13");
}

static int holds(SOCKET g)
{
    /* Links at their closed position, tips a third of the joint angle along; the others where they were. */
    return is_at(g, "1", 331) && is_at(g, "3", 331) && is_at(g, "5", 88) && is_at(g, "7", 88) && is_at(g, "2", 0);
}

START(AT_ZERO)
