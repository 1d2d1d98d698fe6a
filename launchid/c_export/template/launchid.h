/* On-board identification of theta_ddot = a6 theta + k1 beta: $formulation, library $library.

   launchid $version, configuration $digest (the begin of SHA-256 of what a saved state begins with: version, layout,
   every choice).  SPDX-License-Identifier: Apache-2.0

   Made by launchid from the kernels of its Python package: the same operations in the same order, so the same bits
   (IEEE 754 double precision; compile with -ffp-contract=off, without -ffast-math).

   What persists is a `launchid_state`, scratch a `launchid_work`, both owned by the caller, who may place them in
   different memory.  Nothing is allocated, no call waits, every loop has a bound; of other libraries only libm, memset,
   memcpy, memmove and memcmp are called.  One state belongs to one thread.  No address that is given may be NULL. */

#ifndef LAUNCHID_H
#define LAUNCHID_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define LAUNCHID_WINDOW $window        /* s */
#define LAUNCHID_SAMPLE_PERIOD $period /* s */
#define LAUNCHID_TERMS $terms
#define LAUNCHID_MAX_CHANGES $max_changes
#define LAUNCHID_MODES $modes
#define LAUNCHID_MAX_MODES 6
#define LAUNCHID_OFFSETS 5

/* Answer of `launchid_update`: >= 0 the sample was used, < 0 it changed nothing but a counter. */
typedef enum {
$statuses
} launchid_status;

/* Why an estimate is valid or not. */
typedef enum {
$estimate_statuses
} launchid_estimate_status;

/* Names of the library's terms: the rows of xi. */
extern const char *const launchid_terms[LAUNCHID_TERMS];

/* [s, rad, rad/s, rad, rad/s^2, rad, rad]; NaN in theta_dot, theta_ddot, beta_cmd or gamma: not measured. */
typedef struct {
    double t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma;
} launchid_sample;

/* All data so far, the slow deviation from the nominal followed, at t_end [1/s^2].  Formulation `filtered`; else not
   valid. */
typedef struct {
    bool valid;
    double a6, k1, a6_std, k1_std, a6_k1_corr;
} launchid_tracked;

/* Where a parameter is in its range, a = a0 (1 + sigma delta); numbers are NaN where nothing is known yet. */
typedef struct {
    double delta, delta_std;
    int64_t band;                       /* 0: |delta| to $edge_0, 1: to $edge_1, 2: to $edge_2, 3: out, -1: undecided */
    double probability[4];              /* of each band */
    bool in_range;                      /* false while the sequential alarm is raised */
    double out_since;                   /* s; NaN if in_range */
} launchid_level;

/* Of one window; numbers are NaN where not valid. */
typedef struct {
    double t_start, t_end;              /* s */
    bool valid;                         /* status is LAUNCHID_OK */
    launchid_estimate_status status;
    double a6, k1, a6_std, k1_std;      /* 1/s^2, at the window's centre */
    double a6_k1_corr;
    double a6_dot, k1_dot;              /* 1/s^3, coefficients of tau*theta, tau*beta */
    double a6_bound, k1_bound;          /* 1/s^2, Cramer-Rao bound as standard deviations */
    double condition;
    double xi[LAUNCHID_TERMS][3];       /* columns: theta_dot, theta_ddot, beta_dot */
    bool support[LAUNCHID_TERMS][3];
    int64_t rows, gaps;
    launchid_tracked tracked;
    double wind, wind_std;              /* rad, all of the wind angle at t_end; NaN without wind in the model */
    double offset[LAUNCHID_OFFSETS][2]; /* value and standard deviation: thrust misalignment, moment, attitude bias, gyro
                                           bias, nozzle sensor bias; NaN where the model knows it */
    double actuator[3][2];              /* value and standard deviation of the servo's natural frequency [rad/s], damping
                                           ratio, delay [s] at t_end; NaN of a servo that the model knows */
    double actuator_corr[3];            /* their correlations: the first with the second and the third, these two */
    double mode[LAUNCHID_MAX_MODES][4]; /* of slosh, then bending, at t_end: frequency [rad/s] with its standard deviation,
                                           coupling or gain with its own; NaN beyond those of the model */
} launchid_estimate;

/* A sudden change at t [s]: before and after [1/s^2], the alarm [s]; final: two seconds of data are behind its size. */
typedef struct {
    char parameter;                     /* 'a': a6, 'k': k1 */
    double t, t_std, before, after, size, size_std, alarm;
    bool final;
} launchid_change;

/* ---- memory: what each array holds is said in the estimator's own sources.

   For a window of LAUNCHID_WINDOW s, samples LAUNCHID_SAMPLE_PERIOD s apart and LAUNCHID_TERMS terms: $state_bytes bytes that
   persist, $work_bytes of scratch, $fixed_bytes that never change (in launchid.c).  An array of no numbers ("0 x 0") has one, which
   nothing reads: C has no empty array. */

$structs
#define LAUNCHID_BUSY_MARK INT64_C(0x5AA5C33C0FF09669)

/* What persists between samples. */
typedef struct {
$state
    int64_t busy;                       /* LAUNCHID_BUSY_MARK within an update: no single flipped bit makes it so */
} launchid_state;

/* Scratch: meaningless between calls; several estimators that never run at once may share it. */
typedef struct {
$work
} launchid_work;

/* Both in one place, for hosts that have no reason to keep them apart. */
typedef struct {
    launchid_state state;
    launchid_work work;
} launchid_estimator;

/* ---- calls, with state and scratch wherever the caller put them */

/* Forget everything; the first call a state gets. */
void launchid_state_reset(launchid_state *state);

/* Take one sample; never fails, whatever the numbers. */
launchid_status launchid_state_update(launchid_state *state, launchid_work *work, const launchid_sample *sample);

/* The estimate of the last window that closed; false before the first. */
bool launchid_state_estimate(launchid_state *state, launchid_work *work, launchid_estimate *estimate);

/* Sudden changes, oldest first, into change[]; how many (at most 2 LAUNCHID_MAX_CHANGES).  `filtered`; else 0. */
int64_t launchid_state_changes(launchid_state *state, launchid_work *work, launchid_change change[]);

/* The uncertainty level of a6 and k1 at t_end; false before the first window, without a range, or if nothing is known. */
bool launchid_state_level(launchid_state *state, launchid_work *work, launchid_level *a6, launchid_level *k1);

/* How often `launchid_state_update` gave an answer. */
int64_t launchid_state_count(const launchid_state *state, launchid_status status);

/* Interventions of the filter since the reset: measurements left out as outliers, segments begun anew, steps of a noise
   level cut short, sudden changes that a contradiction of the model followed.  0 in the other formulations. */
typedef struct {
    int64_t outliers, restarts, level_clamps, withdrawn_changes;
} launchid_notes;

launchid_notes launchid_state_notes(const launchid_state *state);

/* ---- a state as bytes, to go on from after a restart with the same bits: those of the Python estimator's `save` */

#define LAUNCHID_SAVED_BYTES ${saved_bytes}U

/* Answer of `launchid_restore`; the state is as it was unless it is 0. */
typedef enum {
    LAUNCHID_RESTORED = 0,
    LAUNCHID_SAVED_NOT_WHOLE = 1,       /* another number of bytes */
    LAUNCHID_SAVED_FOREIGN = 2,         /* of something else, another version, another configuration */
    LAUNCHID_SAVED_DAMAGED = 3,         /* its checksum does not fit */
    LAUNCHID_SAVED_NOT_NOW = 4          /* an update is running */
} launchid_restored;

/* false, and nothing written, while an update runs. */
bool launchid_state_save(const launchid_state *state, uint8_t saved[LAUNCHID_SAVED_BYTES]);

launchid_restored launchid_state_restore(launchid_state *state, const uint8_t saved[], size_t bytes);

/* ---- the same for an estimator in one place */

static inline void launchid_reset(launchid_estimator *e) { launchid_state_reset(&e->state); }

static inline launchid_status launchid_update(launchid_estimator *e, const launchid_sample *sample)
{
    return launchid_state_update(&e->state, &e->work, sample);
}

static inline bool launchid_get_estimate(launchid_estimator *e, launchid_estimate *estimate)
{
    return launchid_state_estimate(&e->state, &e->work, estimate);
}

static inline int64_t launchid_get_changes(launchid_estimator *e, launchid_change change[])
{
    return launchid_state_changes(&e->state, &e->work, change);
}

static inline bool launchid_get_level(launchid_estimator *e, launchid_level *a6, launchid_level *k1)
{
    return launchid_state_level(&e->state, &e->work, a6, k1);
}

static inline bool launchid_save(const launchid_estimator *e, uint8_t saved[LAUNCHID_SAVED_BYTES])
{
    return launchid_state_save(&e->state, saved);
}

static inline launchid_restored launchid_restore(launchid_estimator *e, const uint8_t saved[], size_t bytes)
{
    return launchid_state_restore(&e->state, saved, bytes);
}

static inline int64_t launchid_count(const launchid_estimator *e, launchid_status status)
{
    return launchid_state_count(&e->state, status);
}

#endif
