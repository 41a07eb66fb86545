#include "section7.h"

static SOCKET made;

static void example(SOCKET g)
{
    const char *ipaddress = section7_host;
    unsigned short port = section7_port;
    wraptor_close_connection(g, 1000);
    /* Establish a TCP socket connection to the Wraptor */
    if((g = tcp_connect(ipaddress, port)) == -1){
        printf("\nError: Can not connect to Wraptor!");
        exit(-1);
    }
    made = g;
}

static int holds(SOCKET g)
{
    /* The first is closed, the second answers. */
    return g != made && value(made, "1", WRAPTOR_PROPERTY_STAT) == 0 && wraptor_wake_grasper(g, 1) == WRAPTOR_BAD_HANDLE;
}

START(ASLEEP)
