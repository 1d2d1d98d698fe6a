/* Feeds the replay vectors to the estimator and compares every answer with the Python estimator's, bit for bit.  Where
   the vectors say so it saves its state, flies on with other words in it, as after an upset of memory, and then goes on
   from what it saved.  Prints how many answers differ; exit status 0 if none does. */

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
#define END (LAUNCHID_SAVED_BYTES - 4U)
#define PRIME UINT64_C(0x100000001B3)

static launchid_estimator estimator;
static uint8_t saved[LAUNCHID_SAVED_BYTES], upset[LAUNCHID_SAVED_BYTES];
static size_t answers;
static int differences, sample_number;
static bool is_upset;      /* the answers become one word, */
static uint64_t folded;    /* this (FNV-1a) */

static void differ(const char *what, unsigned long got, unsigned long got_low, unsigned long wanted, unsigned long low)
{
    printf("sample %d, answer %lu%s: %08lX%08lX, expected %08lX%08lX\n", sample_number, (unsigned long)answers, what,
           got, got_low, wanted, low);
    differences++;
}

/* The next answer.  Halves of a word: not every C library prints 64 bits. */
static void word(uint64_t of)
{
    if (is_upset) {
        folded = (folded ^ of) * PRIME;
        return;
    }
    if (answers >= VECTOR_ANSWERS) {
        differ(" is one too many", 0UL, 0UL, 0UL, 0UL);
    } else if (of != vector_answer[answers]) {
        const uint64_t wanted = vector_answer[answers];
        differ("", (unsigned long)(of >> 32), (unsigned long)(of & UINT32_MAX), (unsigned long)(wanted >> 32),
               (unsigned long)(wanted & UINT32_MAX));
    }
    answers++;
}

static void put(double x)
{
    uint64_t of;
    memcpy(&of, &x, sizeof of);
    word(x != x ? NO_NUMBER : of);  /* every NaN is one */
}

static void count(int64_t n)
{
    word((uint64_t)n);
}

/* What is not in the vectors but must be so. */
static void expect(bool so, const char *what)
{
    if (!so) {
        printf("expected: %s\n", what);
        differences++;
    }
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
    expect(launchid_get_estimate(&estimator, &e), "an estimate of a window that is complete");
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
    for (int k = 0; k < LAUNCHID_MODES; k++) {
        for (int i = 0; i < 4; i++) {
            put(e.mode[k][i]);
        }
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

/* What is known at a flight's end. */
static void put_end(void)
{
    static launchid_change change[2 * LAUNCHID_MAX_CHANGES];
    const int64_t changes = launchid_get_changes(&estimator, change);
    count(changes);
    for (int64_t k = 0; k < changes; k++) {
        put_change(&change[k]);
    }
    const launchid_notes notes = launchid_state_notes(&estimator.state);
    count(notes.outliers);
    count(notes.restarts);
    count(notes.level_clamps);
    count(notes.withdrawn_changes);
    static const launchid_status all[] = {$statuses};
    for (size_t k = 0; k < sizeof all / sizeof *all; k++) {
        count(launchid_count(&estimator, all[k]));
    }
}

/* CRC-32 of what is saved, bit by bit. */
static uint32_t checksum(const uint8_t of[])
{
    uint32_t crc = UINT32_MAX;
    for (size_t k = 0; k < END; k++) {
        crc ^= of[k];
        for (int bit = 0; bit < 8; bit++) {
            crc = (crc & 1U) != 0U ? (crc >> 1) ^ UINT32_C(0xEDB88320) : crc >> 1;
        }
    }
    return ~crc;
}

static void put_bytes(uint8_t to[], size_t at, uint64_t number, size_t n)
{
    for (size_t k = 0; k < n; k++) {
        to[at + k] = (uint8_t)(number >> (8 * k));
    }
}

/* The words of a saved state as one (FNV-1a), every NaN the same: its sign is the machine's. */
static uint64_t state_of(const uint8_t of[])
{
    uint64_t all = 0;
    for (size_t at = VECTOR_STATE; at < END; at += 8) {
        uint64_t bits = 0;
        for (size_t k = 0; k < 8; k++) {
            bits |= (uint64_t)of[at + k] << (8 * k);
        }
        const bool is_number = (bits << 1) <= UINT64_C(0xFFE0000000000000);
        all = (all ^ (is_number ? bits : NO_NUMBER)) * PRIME;
    }
    return all;
}

static launchid_sample sample_of(const double v[7])
{
    return (launchid_sample){v[0], v[1], v[2], v[3], v[4], v[5], v[6]};
}

static void answer(launchid_status status)
{
    count(status);
    if (status == LAUNCHID_WINDOW_COMPLETE) {
        put_estimate();
    }
}

/* Some samples from a state, and the first of them, in which words are others; the row after the upset's. */
static int fly_upset(int row)
{
    double v[7];
    bool is_whole = false;
    memcpy(upset, saved, sizeof saved);
    memcpy(v, vector_sample[sample_number], sizeof v);
    for (; !is_whole; row++) {
        const uint64_t at = vector_upset[row][1];
        if (at >= LAUNCHID_SAVED_BYTES) {
            memcpy(&v[at - LAUNCHID_SAVED_BYTES], &vector_upset[row][2], sizeof *v);
        } else if (at > 0) {
            put_bytes(upset, (size_t)at, vector_upset[row][2], 8);
        }
        is_whole = vector_upset[row][3] > 0;
    }
    put_bytes(upset, END, checksum(upset), 4);
    launchid_reset(&estimator);
    expect(launchid_restore(&estimator, upset, sizeof upset) == LAUNCHID_RESTORED, "a restored state");
    is_upset = true;
    folded = 0;
    for (uint64_t k = 0; k < vector_upset[row - 1][3]; k++) {
        if (k > 0) {
            memcpy(v, vector_sample[(uint64_t)sample_number + k], sizeof v);
        }
        const launchid_sample s = sample_of(v);
        answer(launchid_update(&estimator, &s));
    }
    put_end();
    expect(launchid_save(&estimator, upset), "a saved state");
    word(state_of(upset));
    is_upset = false;
    word(folded);
    return row;
}

/* All upsets of a sample; then everything is as it was. */
static int fly_upsets(int first)
{
    int row = first;
    expect(launchid_save(&estimator, saved), "a saved state");
    word(state_of(saved));
    while (row < VECTOR_UPSETS && vector_upset[row][0] == (uint64_t)sample_number) {
        row = fly_upset(row);
    }
    launchid_reset(&estimator);
    expect(launchid_restore(&estimator, saved, sizeof saved) == LAUNCHID_RESTORED, "the state as it was");
    return row;
}

/* What is refused, and leaves the state as it is. */
static void refuse(const launchid_sample *s)
{
    launchid_estimate e;
    launchid_level a6, k1;
    (void)launchid_save(&estimator, saved);
    expect(launchid_restore(&estimator, saved, 1U) == LAUNCHID_SAVED_NOT_WHOLE, "refused: not whole");
    saved[END] ^= 1U;
    expect(launchid_restore(&estimator, saved, sizeof saved) == LAUNCHID_SAVED_DAMAGED, "refused: damaged");
    saved[0] ^= 1U;
    put_bytes(saved, END, checksum(saved), 4);
    expect(launchid_restore(&estimator, saved, sizeof saved) == LAUNCHID_SAVED_FOREIGN, "refused: foreign");
    estimator.state.busy = LAUNCHID_BUSY_MARK;
    expect(launchid_update(&estimator, s) == LAUNCHID_BUSY, "busy");
    expect(launchid_count(&estimator, LAUNCHID_BUSY) == 1, "counted as busy");
    expect(!launchid_save(&estimator, saved), "not saved while busy");
    expect(launchid_restore(&estimator, saved, sizeof saved) == LAUNCHID_SAVED_NOT_NOW, "refused: not now");
    launchid_reset(&estimator);
    expect(!launchid_get_estimate(&estimator, &e), "no estimate before the first window");
    expect(!launchid_get_level(&estimator, &a6, &k1), "no level before the first window");
}

int main(void)
{
    int row = 0;
    launchid_sample s = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0};
    for (int flight = 0; flight < VECTOR_FLIGHTS; flight++) {
        launchid_reset(&estimator);
        for (; sample_number < vector_end[flight]; sample_number++) {
            double v[7];
            memcpy(v, vector_sample[sample_number], sizeof v);
            s = sample_of(v);
            if (row < VECTOR_UPSETS && vector_upset[row][0] == (uint64_t)sample_number) {
                row = fly_upsets(row);
            }
            answer(LAUNCHID_UPDATE(&estimator, &s));
        }
        put_end();
    }
    refuse(&s);
    expect(answers == VECTOR_ANSWERS, "as many answers as in the vectors");
    printf("%d samples, %lu answers\n", VECTOR_SAMPLES, (unsigned long)answers);
    LAUNCHID_REPORT();
    printf("%d differences\n", differences);
    return differences == 0 ? EXIT_SUCCESS : EXIT_FAILURE;
}
