/* Feeds a controller the readings in one file and writes what it answers to another.
 *
 * Readings are binary64 numbers of this machine's byte order, SENSORS a step. Answers are ACTIONS
 * numbers a step and a whole number made of the status and each sensor's flags; where COUNTED is
 * defined, also the instructions that the step took and the bytes of stack. The controller starts
 * anew every RESET_EVERY steps.
 */
#include <stdio.h>
#include <stdlib.h>

#include "glue.h"

#define BLOCK 256
#define RESET_EVERY 4096UL

#if defined(COUNTED)
#include "counted.h"
#define EXTRA 2
#else
#define EXTRA 0
#endif

static double readings[BLOCK][SENSORS];
static double answers[BLOCK][ACTIONS + 1 + EXTRA];

static double judged(unsigned status, const NAME(state) *state)
{
    unsigned char flags[SENSORS];
    double total = 0.0;
    unsigned k;
    FLAGS(*state, flags);
    for (k = 0; k < SENSORS; k++) {
        total = total * 4.0 + flags[k];
    }
    return total * 8.0 + status;
}

int main(int argc, char **argv)
{
    FILE *from, *to;
    NAME(state) *state = NULL;
    unsigned long steps = 0;
    size_t got;
    if (argc != 3 || !(from = fopen(argv[1], "rb")) || !(to = fopen(argv[2], "wb"))) {
        return 2;
    }
#if defined(COUNTED)
    start_counting();
#endif
    while ((got = fread(readings, sizeof readings[0], BLOCK, from)) > 0) {
        size_t row;
        for (row = 0; row < got; row++) {
            NAME(observation) in;
            NAME(action) out;
            unsigned status;
            if (steps++ % RESET_EVERY == 0) {
                /* Fresh memory, so that a sanitizer sees what `reset` leaves out. */
                free(state);
                if (!(state = malloc(sizeof *state))) {
                    return 4;
                }
                NAME(reset)(state);
            }
            TAKE(in, readings[row]);
#if defined(COUNTED)
            COUNT(status = NAME(step)(&NAME(default_params), state, &in, &out),
                  answers[row] + ACTIONS + 1);
#else
            status = NAME(step)(&NAME(default_params), state, &in, &out);
#endif
            GIVE(out, answers[row]);
            answers[row][ACTIONS] = judged(status, state);
        }
        if (fwrite(answers, sizeof answers[0], got, to) != got) {
            return 3;
        }
    }
    free(state);
    return fclose(to) == 0 ? 0 : 3;
}
