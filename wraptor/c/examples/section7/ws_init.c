#include "section7.h"

static void example(SOCKET g)
{
    (void)g;
    /* Start up WinSock */
    ws_init();
}

static int holds(SOCKET g)
{
    return value(g, "1", WRAPTOR_PROPERTY_STAT) == 0;
}

START(ASLEEP)
