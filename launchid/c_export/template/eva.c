/* For `make eva` (Frama-C's Eva): any state of memory and any sample, again and again; scratch is what was left there. */

#include "launchid.h"

#include <__fc_builtin.h>
#include <float.h>

static launchid_estimator estimator;

static double any(void)
{
    return Frama_C_double_interval(-DBL_MAX, DBL_MAX);
}

int main(void)
{
    launchid_estimate estimate;
    while (Frama_C_interval(0, 1) != 0) {
        Frama_C_make_unknown((char *)&estimator.state, sizeof estimator.state);
        const launchid_sample sample = {any(), any(), any(), any(), any(), any(), any()};
        (void)launchid_update(&estimator, &sample);
        (void)launchid_get_estimate(&estimator, &estimate);
    }
    return 0;
}
