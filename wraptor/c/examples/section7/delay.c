#include "section7.h"

static void example(SOCKET g)
{
    tcp_msg(g, "1 G MT\r", 7);
    /* Wait for 2.5 seconds */
    delay(2500);
}

static int holds(SOCKET g)
{
    (void)g;
    /* The answer was received and processed meanwhile. */
    return propertyList[1][WRAPTOR_PROPERTY_MT] == 750;
}

START(AWAKE)
