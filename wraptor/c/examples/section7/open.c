#include "section7.h"

static void example(SOCKET g)
{
    move(g, "13", 100);
    /* Open fingers 1 and 3 */
    open(g, "13");
}

static int holds(SOCKET g)
{
    return is_at(g, "1", 0) && is_at(g, "3", 0) && is_at(g, "5", 0) && is_at(g, "7", 0);
}

START(AT_ZERO)
