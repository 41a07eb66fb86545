#include "section7.h"

static long was;

static void example(SOCKET g)
{
    get(g, "1", WRAPTOR_PROPERTY_MT);
    was = propertyList[1][WRAPTOR_PROPERTY_MT];
    /* Initialize the local Wraptor property arrays to zero */
    initSoftware();
}

static int holds(SOCKET g)
{
    (void)g;
    return was == 750 && propertyList[1][WRAPTOR_PROPERTY_MT] == 0;
}

START(AWAKE)
