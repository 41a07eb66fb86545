/*
 Around each example of the manual's section 7: PROGRAM HOST PORT [DISCOVERY] runs `example` with a connection over TCP, PROGRAM serial PORT with one on a
 serial port, PROGRAM can PLACE with one by CAN. `holds` tells whether it did what the manual says. Boards are woken first, and found their zero if the
 example moves, as START says.
 */
#ifndef SECTION7_H
#define SECTION7_H

static const char *section7_discovery;
#define WRAPTOR_COMPAT_PLACE section7_discovery

#include "wraptor_compat.h"

enum start { ASLEEP, AWAKE, AT_ZERO };

static void example(SOCKET g);
static int holds(SOCKET g);

/* Arguments, for examples that connect by themselves. */
static const char *section7_host;
static unsigned short section7_port;

/* The value of a board's property. */
static inline long value(SOCKET g, const char *node, int property)
{
    get(g, node, property);
    return propertyList[node[0] - '0'][property];
}

/* Whether a board's position is a goal's, within the arrival window of 4 hall counts. */
static inline int is_at(SOCKET g, const char *node, long goal)
{
    long found = value(g, node, WRAPTOR_PROPERTY_P);
    if (labs(found - goal) > 4) {
        fprintf(stderr, "board %s: at %ld, expected %ld\n", node, found, goal);
        return 0;
    }
    return 1;
}

/* A connection in the way that the arguments ask for. */
static inline SOCKET section7_connect(const char *place)
{
    if (strcmp(section7_host, "serial") == 0) {
        return serial_connect(place, 9600);
    }
    if (strcmp(section7_host, "can") == 0) {
        return can_connect(place);
    }
    return tcp_connect(section7_host, section7_port);
}

static inline int run(int argc, char **argv, enum start start)
{
    SOCKET g;
    if (argc < 3) {
        fprintf(stderr, "usage: %s HOST PORT [DISCOVERY], serial PORT, can PLACE\n", argv[0]);
        return 2;
    }
    section7_host = argv[1];
    section7_port = (unsigned short)atoi(argv[2]);
    section7_discovery = argc > 3 ? argv[3] : NULL;
    ws_init();
    initSoftware();
    g = section7_connect(argv[2]);
    if (g == -1) {
        return 1;
    }
    if (start != ASLEEP) {
        wakeGrasper(g);
    }
    if (start == AT_ZERO) {
        findZero(g, "1234567");
    }
    example(g);
    if (wraptor_error_text()[0] != '\0' || !holds(g)) {
        fprintf(stderr, "%s: it did not do what the manual says\n", argv[0]);
        return 1;
    }
    return ws_down();
}

#define START(start) int main(int argc, char **argv) { return run(argc, argv, start); }

#endif
