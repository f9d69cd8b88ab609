/* Feeds a controller the same readings whoever wrote it, and prints a digest of its answers.
 *
 * Compile with -DHEADER="..." -DNAME(x)=prefix_##x -DSENSORS=a,b -DACTION=a, and with the ranges
 * in RANGES. One reading in 64 is missing, one in 64 outside its range.
 */
#include HEADER

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static unsigned long long word = 88172645463325252ull;

static double uniform(void)
{
    word ^= word << 13;
    word ^= word >> 7;
    word ^= word << 17;
    return (double)(word >> 11) / 9007199254740992.0;
}

int main(int argc, char **argv)
{
    static const double ranges[][2] = RANGES;
    enum { count = sizeof ranges / sizeof ranges[0] };
    const long steps = argc > 1 ? atol(argv[1]) : 1000;
    const double zero = steps < 0 ? 1.0 : 0.0;
    unsigned long long digest = 1469598103934665603ull;
    NAME(state) state;
    long step;

    NAME(reset)(&state);
    for (step = 0; step < steps; step++) {
        double readings[count];
        NAME(observation) in;
        NAME(action) out;
        double action;
        unsigned status;
        unsigned long long bits;
        int k;

        for (k = 0; k < count; k++) {
            const double chance = uniform();
            const double width = ranges[k][1] - ranges[k][0];
            readings[k] = ranges[k][0] + width * uniform();
            if (chance < 1.0 / 64) {
                readings[k] = zero / zero;
            } else if (chance < 2.0 / 64) {
                readings[k] += 2.0 * width;
            }
        }
        k = 0;
        READ(in, readings)
        status = NAME(step)(&NAME(default_params), &state, &in, &out);
        action = (double)out.ACTION;
        memcpy(&bits, &action, sizeof bits);
        digest = (digest ^ bits ^ status) * 1099511628211ull;
    }
    printf("%016llx\n", digest);
    return 0;
}
