/* Times every update of the C port over the samples on stdin, REPEATS times; prints the least time of each sample, ns.
   With a second argument: processor time a sample of each whole pass instead, no clock between the updates. */

#define _POSIX_C_SOURCE 199309L

#include "launchid.h"

#include <stdio.h>
#include <stdlib.h>
#include <time.h>

static launchid_estimator estimator;

static double now(clockid_t clock)
{
    struct timespec t;
    clock_gettime(clock, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

int main(int argc, char **argv)
{
    const int repeats = argc > 1 ? atoi(argv[1]) : 1;
    const size_t room = 1000000;
    launchid_sample *sample = malloc(room * sizeof *sample);
    double *least = malloc(room * sizeof *least);
    size_t n = 0;
    while (n < room && sample && scanf("%lf %lf %lf %lf %lf %lf %lf", &sample[n].t, &sample[n].theta, &sample[n].theta_dot,
                                       &sample[n].beta, &sample[n].theta_ddot, &sample[n].beta_cmd,
                                       &sample[n].gamma) == 7) {
        n++;
    }
    for (int repeat = 0; argc > 2 && repeat < repeats; repeat++) {
        launchid_reset(&estimator);
        const double begin = now(CLOCK_PROCESS_CPUTIME_ID);
        for (size_t k = 0; k < n; k++) {
            launchid_update(&estimator, &sample[k]);
        }
        least[repeat] = (now(CLOCK_PROCESS_CPUTIME_ID) - begin) / (double)n;
    }
    for (int repeat = 0; argc == 2 && repeat < repeats && least; repeat++) {
        launchid_reset(&estimator);
        for (size_t k = 0; k < n; k++) {
            const double begin = now(CLOCK_MONOTONIC);
            launchid_update(&estimator, &sample[k]);
            const double taken = now(CLOCK_MONOTONIC) - begin;
            least[k] = repeat == 0 || taken < least[k] ? taken : least[k];
        }
    }
    printf("%zu\n", sizeof estimator);
    for (size_t k = 0; k < (argc > 2 ? (size_t)repeats : n) && least; k++) {
        printf("%.1f\n", least[k]);
    }
    free(sample);
    free(least);
    return 0;
}
