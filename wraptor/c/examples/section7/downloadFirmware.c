#include "section7.h"

static void example(SOCKET g)
{
    /* Download new firmware */
    char fname[127], nodes[16];
    printf("Load Firmware: ");
    gets(fname);
    printf("To which nodes: ");
    gets(nodes);
    downloadFirmware(g, nodes, fname);
}

static int holds(SOCKET g)
{
    /* It runs the application. */
    return value(g, "2", WRAPTOR_PROPERTY_STAT) == 2 && value(g, "1", WRAPTOR_PROPERTY_STAT) == 0;
}

START(ASLEEP)
