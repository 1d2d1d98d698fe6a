/* Times every update of the C port over the samples on stdin, REPEATS times; prints the least time of each sample, ns. */

#define _POSIX_C_SOURCE 199309L

#include "launchid.h"

#include <stdio.h>
#include <stdlib.h>
#include <time.h>

static launchid_estimator estimator;

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

int main(int argc, char **argv)
{
    const int repeats = argc > 1 ? atoi(argv[1]) : 1;
    const size_t room = 1000000;
    launchid_sample *sample = malloc(room * sizeof *sample);
    double *least = malloc(room * sizeof *least);
    size_t n = 0;
    while (n < room && sample && scanf("%lf %lf %lf %lf %lf %lf", &sample[n].t, &sample[n].theta, &sample[n].theta_dot,
                                       &sample[n].beta, &sample[n].theta_ddot, &sample[n].beta_cmd) == 6) {
        n++;
    }
    for (int repeat = 0; repeat < repeats && least; repeat++) {
        launchid_reset(&estimator);
        for (size_t k = 0; k < n; k++) {
            const double begin = now();
            launchid_update(&estimator, &sample[k]);
            const double taken = now() - begin;
            least[k] = repeat == 0 || taken < least[k] ? taken : least[k];
        }
    }
    printf("%zu\n", sizeof estimator);
    for (size_t k = 0; k < n && least; k++) {
        printf("%.0f\n", least[k]);
    }
    free(sample);
    free(least);
    return 0;
}
