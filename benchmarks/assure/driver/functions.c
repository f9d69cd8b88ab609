/* exp and tanh, in both precisions, of the numbers in one file, into another. */
#include <math.h>
#include <stdio.h>

int main(int argc, char **argv)
{
    FILE *from, *to;
    double x;
    if (argc != 3 || !(from = fopen(argv[1], "rb")) || !(to = fopen(argv[2], "wb"))) {
        return 2;
    }
    while (fread(&x, sizeof x, 1, from) == 1) {
        const float f = (float)x;
        double y[4];
        y[0] = exp(x);
        y[1] = (double)expf(f);
        y[2] = tanh(x);
        y[3] = (double)tanhf(f);
        if (fwrite(y, sizeof y, 1, to) != 1) {
            return 3;
        }
    }
    return fclose(to) == 0 ? 0 : 3;
}
