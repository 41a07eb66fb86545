#include "section7.h"

static void example(SOCKET g)
{
    set(g, "1", WRAPTOR_PROPERTY_P, 77);
    /* Send a character string to the Wraptor */
    tcp_msg(g, "1 G AP", 6);
}

static int holds(SOCKET g)
{
    /* The line ends with the next call, and its answer is in the list. */
    get(g, "2", WRAPTOR_PROPERTY_MT);
    return propertyList[1][WRAPTOR_PROPERTY_P] == 77 && propertyList[2][WRAPTOR_PROPERTY_MT] == 750;
}

START(AWAKE)
