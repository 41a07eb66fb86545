#include "section7.h"

static void example(SOCKET g)
{
    /* Move fingers 1 and 2 to position 250 */
    move(g, "12", 250);
}

static int holds(SOCKET g)
{
    return is_at(g, "1", 250) && is_at(g, "2", 250) && is_at(g, "5", 66) && is_at(g, "6", 66) && is_at(g, "3", 0);
}

START(AT_ZERO)
