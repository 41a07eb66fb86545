#include "section7.h"

static void example(SOCKET g)
{
    (void)g;
    /* Shut down WinSock, break communication with Wraptor */
    ws_down();
}

static int holds(SOCKET g)
{
    return wraptor_wake_grasper(g, 1000) == WRAPTOR_BAD_HANDLE;
}

START(AWAKE)
