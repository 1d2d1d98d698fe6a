/* Feeds the replay vectors to the estimator and compares every answer with the Python estimator's, bit for bit; half
   way it saves its state and goes on from what it saved.  Prints how many answers differ; exit status 0 if none does. */

#include "launchid.h"
#include "vectors.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef LAUNCHID_UPDATE  /* a target's own, which measures */
launchid_status LAUNCHID_UPDATE(launchid_estimator *e, const launchid_sample *s);
void LAUNCHID_REPORT(void);
#else
#define LAUNCHID_UPDATE launchid_update
#define LAUNCHID_REPORT() ((void)0)
#endif

#define NO_NUMBER UINT64_C(0x7FF8000000000000)
#define ROOM 2048

static launchid_estimator estimator;
static uint8_t saved[LAUNCHID_SAVED_BYTES];
static uint64_t word[ROOM];
static size_t words;
static int differences;

static double number(uint64_t of)
{
    double x;
    memcpy(&x, &of, sizeof x);
    return x;
}

static void put(double x)
{
    uint64_t of;
    memcpy(&of, &x, sizeof of);
    word[words++] = x != x ? NO_NUMBER : of;  /* every NaN is one */
}

static void count(int64_t n)
{
    word[words++] = (uint64_t)n;
}

/* Halves of a word: not every C library prints 64 bits. */
static unsigned long high(uint64_t of)
{
    return (unsigned long)(of >> 32);
}

static unsigned long low(uint64_t of)
{
    return (unsigned long)(of & UINT32_MAX);
}

/* Answers so far with those expected. */
static void compare(const char *what, int at, const uint64_t expected[], size_t n)
{
    if (words != n) {
        printf("%s %d: %u numbers, expected %u\n", what, at, (unsigned)words, (unsigned)n);
        differences++;
    }
    for (size_t k = 0; k < words && k < n; k++) {
        if (word[k] != expected[k]) {
            printf("%s %d, number %u: %08lX%08lX, expected %08lX%08lX\n", what, at, (unsigned)k, high(word[k]),
                   low(word[k]), high(expected[k]), low(expected[k]));
            differences++;
        }
    }
    words = 0;
}

static void put_level(const launchid_level *l, bool there)
{
    if (!there) {
        for (int k = 0; k < 9; k++) {
            count(0);
        }
        return;
    }
    count(l->band);
    count(l->in_range);
    put(l->delta);
    put(l->delta_std);
    for (int k = 0; k < 4; k++) {
        put(l->probability[k]);
    }
    put(l->out_since);
}

static void put_estimate(void)
{
    launchid_estimate e;
    launchid_level a6, k1;
    (void)launchid_get_estimate(&estimator, &e);
    const double numbers[] = {e.t_start, e.t_end, e.a6, e.k1, e.a6_std, e.k1_std, e.a6_k1_corr, e.a6_dot, e.k1_dot,
                              e.a6_bound, e.k1_bound, e.condition};
    const double tracked[] = {e.tracked.a6, e.tracked.k1, e.tracked.a6_std, e.tracked.k1_std, e.tracked.a6_k1_corr,
                              e.wind, e.wind_std};
    count(e.status);
    count(e.rows);
    count(e.gaps);
    for (size_t k = 0; k < sizeof numbers / sizeof *numbers; k++) {
        put(numbers[k]);
    }
    for (int k = 0; k < 3 * LAUNCHID_TERMS; k++) {
        put(e.xi[k / 3][k % 3]);
    }
    for (int k = 0; k < 3 * LAUNCHID_TERMS; k++) {
        count(e.support[k / 3][k % 3]);
    }
    count(e.tracked.valid);
    for (size_t k = 0; k < sizeof tracked / sizeof *tracked; k++) {
        put(tracked[k]);
    }
    for (int k = 0; k < LAUNCHID_OFFSETS; k++) {
        put(e.offset[k][0]);
        put(e.offset[k][1]);
    }
    for (int k = 0; k < 3; k++) {
        put(e.actuator[k][0]);
        put(e.actuator[k][1]);
        put(e.actuator_corr[k]);
    }
    const bool there = launchid_get_level(&estimator, &a6, &k1);
    count(there);
    put_level(&a6, there);
    put_level(&k1, there);
}

static void put_change(const launchid_change *c)
{
    const double numbers[] = {c->t, c->t_std, c->before, c->after, c->size, c->size_std, c->alarm};
    count(c->parameter);
    for (size_t k = 0; k < sizeof numbers / sizeof *numbers; k++) {
        put(numbers[k]);
    }
    count(c->final);
}

/* The state is saved, lost and restored. */
static void restart(void)
{
    const uint8_t *const end = &saved[LAUNCHID_SAVED_BYTES - 4];
    (void)launchid_save(&estimator, saved);
    count((int64_t)((uint32_t)end[0] | (uint32_t)end[1] << 8 | (uint32_t)end[2] << 16 | (uint32_t)end[3] << 24));
    const uint64_t expected[] = {VECTOR_SAVED_CHECKSUM};
    compare("saved state's checksum, sample", VECTOR_SAVED_AT, expected, 1);
    launchid_reset(&estimator);
    count(launchid_restore(&estimator, saved, sizeof saved));
    const uint64_t restored[] = {LAUNCHID_RESTORED};
    compare("restored at sample", VECTOR_SAVED_AT, restored, 1);
}

int main(void)
{
    static launchid_change change[2 * LAUNCHID_MAX_CHANGES];
    int windows = 0;
    launchid_reset(&estimator);
    for (int k = 0; k < VECTOR_SAMPLES; k++) {
        const uint64_t *const v = vector_sample[k];
        const launchid_sample s = {number(v[0]), number(v[1]), number(v[2]), number(v[3]), number(v[4]), number(v[5]),
                                   number(v[6])};
        if (k == VECTOR_SAVED_AT) {
            restart();
        }
        const launchid_status status = LAUNCHID_UPDATE(&estimator, &s);
        const uint64_t expected[] = {(uint64_t)vector_status[k]};
        count(status);
        compare("status of sample", k, expected, 1);
        if (status == LAUNCHID_WINDOW_COMPLETE && windows < VECTOR_WINDOWS) {
            put_estimate();
            compare("window", windows, vector_window[windows], VECTOR_WORDS);
            windows++;
        }
    }
    const int64_t changes = launchid_get_changes(&estimator, change);
#if VECTOR_CHANGES > 0
    for (int k = 0; k < (int)changes && k < VECTOR_CHANGES; k++) {
        put_change(&change[k]);
        compare("change", k, vector_change[k], 9);
    }
#else
    (void)put_change;
    (void)vector_change;
#endif
    const launchid_notes notes = launchid_state_notes(&estimator.state);
    count(notes.outliers);
    count(notes.restarts);
    count(notes.level_clamps);
    count(notes.withdrawn_changes);
    compare("notes", 0, vector_notes, 4);
    differences += (int)changes != VECTOR_CHANGES || windows != VECTOR_WINDOWS;
    printf("%d samples, %d windows, %d changes\n", VECTOR_SAMPLES, windows, (int)changes);
    LAUNCHID_REPORT();
    printf("%d differences\n", differences);
    return differences == 0 ? EXIT_SUCCESS : EXIT_FAILURE;
}
