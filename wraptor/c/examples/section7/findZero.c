#include "section7.h"

static void example(SOCKET g)
{
    /* Find the zero-point on all motors */
    findZero(g, "1234567");
}

static int holds(SOCKET g)
{
    return is_at(g, "1", 0) && is_at(g, "2", 0) && is_at(g, "3", 0) && is_at(g, "4", 0) && is_at(g, "5", 0) &&
           is_at(g, "6", 0) && is_at(g, "7", 0) && (value(g, "1", WRAPTOR_PROPERTY_HALLH) >> 30 & 1) == 1;
}

START(AWAKE)
