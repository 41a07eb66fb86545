#include "section7.h"

static int found;

static void example(SOCKET g)
{
    /* Find the Wraptor on the network */
    int port;
    char mac[127], ipaddress[127];
    discoverGrasper(mac, ipaddress, &port);
    (void)g;
    found = port == section7_port && strcmp(ipaddress, section7_host) == 0;
}

static int holds(SOCKET g)
{
    (void)g;
    return found;
}

START(ASLEEP)
