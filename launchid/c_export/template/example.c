/* How a host uses the estimator: its memory once, a sample each period, an estimate where a window closed.

   cc -std=c99 -O2 -ffp-contract=off example.c launchid.c -lm -o example */

#include "launchid.h"
#include "vectors.h"

#include <stdio.h>
#include <string.h>

/* What persists and scratch may lie in different memory; nothing else is needed. */
static launchid_state state;
static launchid_work work;

/* Stands for the vehicle's sensors: false at the end of the flight. */
static bool next_sample(int k, launchid_sample *s)
{
    double value[7];
    if (k >= VECTOR_FIRST) {
        return false;
    }
    memcpy(value, vector_sample[k], sizeof value);
    *s = (launchid_sample){value[0], value[1], value[2], value[3], value[4], value[5], value[6]};
    return true;
}

int main(void)
{
    launchid_sample sample;
    launchid_estimate estimate;
    launchid_state_reset(&state);
    printf("end of window: a6, k1 (+- is one standard deviation)\n");
    for (int k = 0; next_sample(k, &sample); k++) {
        const launchid_status status = launchid_state_update(&state, &work, &sample);
        if (status < 0) {
            printf("sample %d refused: %d\n", k, (int)status);
        } else if (status == LAUNCHID_WINDOW_COMPLETE && launchid_state_estimate(&state, &work, &estimate)) {
            printf("%6.2f s: a6 %.4f +- %.4f, k1 %.4f +- %.4f 1/s^2%s\n", estimate.t_end, estimate.a6,
                   estimate.a6_std, estimate.k1, estimate.k1_std, estimate.valid ? "" : " (not valid)");
        } else {
            /* taken, or taken after a gap: the window goes on */
        }
    }
    return 0;
}
