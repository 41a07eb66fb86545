#include <sys/select.h>

#include "section7.h"

static struct timeval ten_ms = { 0, 10000 };

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
        select(0, NULL, NULL, NULL, &ten_ms);
        ten_ms.tv_usec = 10000;
    }
    return propertyList[1][WRAPTOR_PROPERTY_MT] == 750;
}

START(AWAKE)
