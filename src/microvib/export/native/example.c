/* A drive for a while: gcc example.c ./drive-linux64.so -lm -o example && ./example */

#include <stdio.h>
#include <stdlib.h>

#include "microvib.h"

int main(void)
{
    char why[256];
    microvib *drive = microvib_new(why, sizeof why);
    if (!drive) {
        fprintf(stderr, "%s\n", why);
        return 1;
    }
    int torque = microvib_find_output(drive, "T_d"), mean = microvib_find_output(drive, "T_d_mean");
    void *kept = malloc(microvib_state_bytes(drive));
    double at_end[2];

    printf("time_s,t_d_n_m,t_d_mean_n_m\n");
    for (int k = 1; k <= 200; k++) {
        if (microvib_do_step(drive, 0.01 * k)) {
            fprintf(stderr, "%s\n", microvib_error(drive));
            return 1;
        }
        if (k == 100)
            microvib_get_state(drive, kept);
        printf("%.17g,%.17g,%.17g\n", microvib_time(drive), microvib_output(drive, torque), microvib_output(drive, mean));
    }
    at_end[0] = microvib_output(drive, torque);

    /* Back to the middle, and on again: the same to the last bit. */
    microvib_set_state(drive, kept);
    for (int k = 101; k <= 200; k++)
        if (microvib_do_step(drive, 0.01 * k))
            return 1;
    at_end[1] = microvib_output(drive, torque);
    free(kept);
    microvib_free(drive);
    return at_end[0] == at_end[1] ? 0 : 2;
}
