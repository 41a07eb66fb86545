/* A first program: grasp HOST PORT wakes the hand, finds its zero, closes finger 1 and prints where it is. */

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#include "wraptor.h"

static void check(wraptor_error error)
{
    if (error != WRAPTOR_OK) {
        fprintf(stderr, "error: %s\n", wraptor_error_text());
        exit(1);
    }
}

int main(int argc, char **argv)
{
    wraptor_hand hand;
    int64_t positions[WRAPTOR_NODES];
    if (argc != 3) {
        fprintf(stderr, "usage: grasp HOST PORT\n");
        return 2;
    }
    check(wraptor_tcp_connect(argv[1], (uint16_t)atoi(argv[2]), &hand, 5000));
    check(wraptor_wake_grasper(hand, 5000));
    check(wraptor_find_zero(hand, "1234567", 60000));
    check(wraptor_close(hand, "1", 20000));
    check(wraptor_get(hand, "15", WRAPTOR_PROPERTY_P, positions, 1000));
    printf("link at %" PRId64 ", tip at %" PRId64 " hall counts\n", positions[1], positions[5]);
    check(wraptor_close_connection(hand, 1000));
    return 0;
}
