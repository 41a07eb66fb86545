#include "section7.h"

static void example(SOCKET g)
{
    /* Launch the TCP Listener */
    DWORD nThreadID;
    CreateThread(0, 0, Listener, (void*)g, 0, &nThreadID);
}

static int holds(SOCKET g)
{
    int tries = 0;
    tcp_msg(g, "1 G MT\r", 7);
    /* It receives and processes the answer while this thread sleeps. */
    while (propertyList[1][WRAPTOR_PROPERTY_MT] != 750 && tries++ < 3000) {
        delay(10);
    }
    return propertyList[1][WRAPTOR_PROPERTY_MT] == 750;
}

START(AWAKE)
