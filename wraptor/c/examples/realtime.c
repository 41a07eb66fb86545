/* Measures RealTime: realtime HOST PORT [BLOCKS_A_SECOND [SECONDS [MOTORS]]]. Wakes and homes the hand, closes and opens its motors slowly. */

#include <stdio.h>
#include <stdlib.h>

#include "wraptor.h"

/* Hall counts/s, and after how many blocks motors turn back. */
#define VELOCITY 40
#define TURN 300

static int on_block(
    void *context, uint64_t block, const wraptor_axis *axes, size_t count, double temperature, wraptor_control *controls)
{
    const uint64_t *blocks = (const uint64_t *)context;
    size_t axis;
    (void)axes;
    (void)temperature;
    for (axis = 0; axis < count; axis++) {
        controls[axis].velocity = block / TURN % 2 == 0 ? VELOCITY : -VELOCITY;
    }
    return block < *blocks;
}

static void check(wraptor_error error)
{
    if (error != WRAPTOR_OK) {
        fprintf(stderr, "error: %s\n", wraptor_error_text());
        exit(1);
    }
}

int main(int argc, char **argv)
{
    const char *host = argc > 1 ? argv[1] : "127.0.0.1";
    int port = argc > 2 ? atoi(argv[2]) : 11001;
    double rate = argc > 3 ? atof(argv[3]) : 300;
    uint64_t blocks = (uint64_t)(rate * (argc > 4 ? atof(argv[4]) : 10));
    const char *motors = argc > 5 ? argv[5] : "G";
    wraptor_hand hand;
    wraptor_statistics run;
    check(wraptor_tcp_connect(host, (uint16_t)port, &hand, 5000));
    check(wraptor_wake_grasper(hand, 5000));
    check(wraptor_find_zero(hand, "1234567", 60000));
    check(wraptor_realtime(hand, motors, NULL, rate, 1000, on_block, &blocks, &run, 2000));
    printf("%s: %.1f blocks/s of %g, %llu missed\n", motors, run.rate, rate, (unsigned long long)run.missed);
    printf("  sent late by: median %.3f ms, 99 %% %.3f ms, maximum %.3f ms\n", run.jitter_ms[0], run.jitter_ms[1],
           run.jitter_ms[2]);
    printf("  round trip: median %.3f ms, 99 %% %.3f ms, maximum %.3f ms\n", run.round_trip_ms[0], run.round_trip_ms[1],
           run.round_trip_ms[2]);
    check(wraptor_close_connection(hand, 1000));
    return 0;
}
