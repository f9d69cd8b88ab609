/* Prints the nanoseconds of a step, over all the readings in a file: ROUNDS lines. */
#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <time.h>

#include "glue.h"

static double readings[STEPS][SENSORS];
static double answers[STEPS][ACTIONS];
static NAME(state) state;

int main(int argc, char **argv)
{
    FILE *from;
    int round;
    if (argc != 2 || !(from = fopen(argv[1], "rb")) ||
        fread(readings, sizeof readings[0], STEPS, from) != STEPS) {
        return 2;
    }
    for (round = 0; round < ROUNDS; round++) {
        struct timespec start, end;
        unsigned long step;
        NAME(reset)(&state);
        clock_gettime(CLOCK_MONOTONIC, &start);
        for (step = 0; step < STEPS; step++) {
            NAME(observation) in;
            NAME(action) out;
            TAKE(in, readings[step]);
            (void)NAME(step)(&NAME(default_params), &state, &in, &out);
            GIVE(out, answers[step]);
        }
        clock_gettime(CLOCK_MONOTONIC, &end);
        printf("%.3f\n", ((double)(end.tv_sec - start.tv_sec) * 1e9 +
                          (double)(end.tv_nsec - start.tv_nsec)) / STEPS);
    }
    return 0;
}
