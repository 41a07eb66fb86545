#include "section7.h"

static void example(SOCKET g)
{
    /* Prepare the Wraptor for initial commands */
    wakeGrasper(g);
}

static int holds(SOCKET g)
{
    return value(g, "1", WRAPTOR_PROPERTY_STAT) == 2 && value(g, "7", WRAPTOR_PROPERTY_STAT) == 2;
}

START(ASLEEP)
