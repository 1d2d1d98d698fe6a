/* Runs the estimator over samples on stdin, one a line: t theta theta_dot beta theta_ddot beta_cmd gamma, `nan`
   where not measured; anything else, such as a CSV, is status 1 and a line on stderr.  Prints what it answers: a line a
   sample (its status), a line a window, its uncertainty level, at the end the sudden changes and what the filter did of
   its own accord (outliers, restarts, level clamps); numbers as hexadecimal floats, so that bits can be compared.

   cc -std=c99 -O2 -ffp-contract=off replay.c launchid.c -lm -o replay */

#include "launchid.h"

#include <inttypes.h>
#include <stdio.h>

static launchid_estimator estimator;

static void print_estimate(const launchid_estimate *e)
{
    printf("window %d %" PRId64 " %" PRId64 " %a %a %a %a %a %a %a %a %a %a %a %a", (int)e->status, e->rows, e->gaps,
           e->t_start, e->t_end, e->a6, e->k1, e->a6_std, e->k1_std, e->a6_k1_corr, e->a6_dot, e->k1_dot, e->a6_bound,
           e->k1_bound, e->condition);
    for (int term = 0; term < LAUNCHID_TERMS; term++) {
        for (int equation = 0; equation < 3; equation++) {
            printf(" %a %d", e->xi[term][equation], e->support[term][equation]);
        }
    }
    const launchid_tracked *t = &e->tracked;
    printf(" %d %a %a %a %a %a", t->valid, t->a6, t->k1, t->a6_std, t->k1_std, t->a6_k1_corr);
    printf(" %a %a", e->wind, e->wind_std);
    for (int k = 0; k < LAUNCHID_OFFSETS; k++) {
        printf(" %a %a", e->offset[k][0], e->offset[k][1]);
    }
    for (int k = 0; k < 3; k++) {
        printf(" %a %a %a", e->actuator[k][0], e->actuator[k][1], e->actuator_corr[k]);
    }
    for (int k = 0; k < LAUNCHID_MODES; k++) {
        printf(" %a %a %a %a", e->mode[k][0], e->mode[k][1], e->mode[k][2], e->mode[k][3]);
    }
    printf("\n");
}

static void print_level(const char *name, const launchid_level *l)
{
    printf("level %s %" PRId64 " %d %a %a %a %a %a %a %a\n", name, l->band, l->in_range, l->delta, l->delta_std,
           l->probability[0], l->probability[1], l->probability[2], l->probability[3], l->out_since);
}

int main(void)
{
    launchid_sample s;
    launchid_estimate estimate;
    launchid_level a6, k1;
    launchid_change change[2 * LAUNCHID_MAX_CHANGES];
    int found;
    long samples = 0;
    launchid_reset(&estimator);
    while ((found = scanf("%lf %lf %lf %lf %lf %lf %lf", &s.t, &s.theta, &s.theta_dot, &s.beta, &s.theta_ddot,
                          &s.beta_cmd, &s.gamma)) == 7) {
        samples++;
        const launchid_status status = launchid_update(&estimator, &s);
        printf("%d\n", (int)status);
        if (status == LAUNCHID_WINDOW_COMPLETE && launchid_get_estimate(&estimator, &estimate)) {
            print_estimate(&estimate);
            if (launchid_get_level(&estimator, &a6, &k1)) {
                print_level("a6", &a6);
                print_level("k1", &k1);
            }
        }
    }
    if (found != EOF) {
        fprintf(stderr, "replay: sample %ld: expected seven numbers with blanks between, t theta theta_dot beta "
                        "theta_ddot beta_cmd gamma (nan: not measured), and no header\n", samples + 1);
        return 1;
    }
    const int64_t changes = launchid_get_changes(&estimator, change);
    for (int64_t k = 0; k < changes; k++) {
        const launchid_change *c = &change[k];
        printf("change %c %a %a %a %a %a %a %a %d\n", c->parameter, c->t, c->t_std, c->before, c->after, c->size,
               c->size_std, c->alarm, c->final);
    }
    const launchid_notes notes = launchid_state_notes(&estimator.state);
    printf("notes %" PRId64 " %" PRId64 " %" PRId64 " %" PRId64 "\n", notes.outliers, notes.restarts, notes.level_clamps,
           notes.withdrawn_changes);
    return 0;
}
