/* On-board identification of theta_ddot = a6 theta + k1 beta: $formulation, library $library.

   Made by launchid from the kernels of its Python package: the same operations in the same order, so the same bits
   (IEEE 754 double precision, the same libm; compile with -ffp-contract=off, without -ffast-math).

   All that persists is in `launchid_estimator`, which the caller owns: $bytes bytes; views of it are on the stack
   (-fstack-usage tells how many bytes).  Nothing is allocated, no call waits, every loop has a bound; of other libraries
   only libm, memset, memcpy and memmove are called.  One estimator belongs to one thread. */

#ifndef LAUNCHID_H
#define LAUNCHID_H

#include <stdbool.h>
#include <stdint.h>

#define LAUNCHID_WINDOW $window        /* s */
#define LAUNCHID_SAMPLE_PERIOD $period /* s */
#define LAUNCHID_TERMS $terms
#define LAUNCHID_MAX_CHANGES $max_changes

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

/* [s, rad, rad/s, rad, rad/s^2, rad]; NaN in theta_dot, theta_ddot or beta_cmd: not measured. */
typedef struct {
    double t, theta, theta_dot, beta, theta_ddot, beta_cmd;
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
} launchid_estimate;

/* A sudden change at t [s]: before and after [1/s^2], the alarm [s]; final: two seconds of data are behind its size. */
typedef struct {
    char parameter;                     /* 'a': a6, 'k': k1 */
    double t, t_std, before, after, size, size_std, alarm;
    bool final;
} launchid_change;

/* All that persists, and the scratch; its fields are the estimator's own. */
typedef struct {
$fields
    int64_t waiting;
    bool busy, has_estimate;
} launchid_estimator;

/* Forget everything; the first call an estimator gets. */
void launchid_reset(launchid_estimator *e);

/* Take one sample; never fails, whatever the numbers. */
launchid_status launchid_update(launchid_estimator *e, const launchid_sample *sample);

/* The estimate of the last window that closed; false before the first. */
bool launchid_get_estimate(launchid_estimator *e, launchid_estimate *estimate);

/* Sudden changes, oldest first, into change[]; how many (at most 2 LAUNCHID_MAX_CHANGES).  `filtered`; else 0. */
int64_t launchid_get_changes(launchid_estimator *e, launchid_change change[]);

/* The uncertainty level of a6 and k1 at t_end; false before the first window, without a range, or if nothing is known. */
bool launchid_get_level(launchid_estimator *e, launchid_level *a6, launchid_level *k1);

/* How often `launchid_update` gave an answer. */
int64_t launchid_count(const launchid_estimator *e, launchid_status status);

#endif
