/* Counts the instructions and the stack of a function that CasADi generated.
 *
 * Reads INPUTS numbers a step, writes OUTPUTS and the two counts.
 */
#include <stdio.h>

#include "counted.h"
#include "twin.h"

#define BLOCK 64

static double readings[BLOCK][INPUTS];
static double answers[BLOCK][OUTPUTS + 2];

int main(int argc, char **argv)
{
    static REAL windows[INPUTS], actions[OUTPUTS], work[twin_SZ_W + 1];
    static int whole[twin_SZ_IW + 1];
    const REAL *arguments[twin_SZ_ARG + 1] = {windows};
    REAL *results[twin_SZ_RES + 1] = {actions};
    FILE *from, *to;
    size_t got;
    if (argc != 3 || !(from = fopen(argv[1], "rb")) || !(to = fopen(argv[2], "wb"))) {
        return 2;
    }
    start_counting();
    while ((got = fread(readings, sizeof readings[0], BLOCK, from)) > 0) {
        size_t row;
        int k;
        for (row = 0; row < got; row++) {
            for (k = 0; k < INPUTS; k++) {
                windows[k] = (REAL)readings[row][k];
            }
            COUNT(twin(arguments, results, whole, work, 0), answers[row] + OUTPUTS);
            for (k = 0; k < OUTPUTS; k++) {
                answers[row][k] = (double)actions[k];
            }
        }
        if (fwrite(answers, sizeof answers[0], got, to) != got) {
            return 3;
        }
    }
    return fclose(to) == 0 ? 0 : 3;
}
