/* Damages what persists and flies on.  Arguments: seed, number of times, kind; samples on stdin as `replay`.

   kind  bit:   one bit flips
         pair:  the same bit flips in two words
         near:  the same bit flips in two neighbouring words
         swap:  two neighbouring words are exchanged
         zero:  64 bytes become 0
   It comes before a random sample of the third last window but two; what becomes of it is, of the first that holds:
     anew       an update answers RECOVERED: the seals have told
     same       every answer until the end has its bits, and so has the state but for counters
     forgotten  at the end of a window all of the state has its bits again
     flagged    an answer is another, a window is not valid, or the filter has intervened more often
     little     numbers of no window move by a tenth of a standard deviation
     more       anything else
   Prints how many of each, and the most windows until one was forgotten. */

#include "launchid.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define SAMPLES 4000
#define AFTER 4      /* windows that close after the one in which a bit flips */
#define LITTLE 0.1   /* standard deviations */

enum { ANEW, SAME, FORGOTTEN, FLAGGED, MOVED_LITTLE, MORE, CLASSES };
static const char *const names[CLASSES] = {"anew", "same", "forgotten", "flagged", "little", "more"};

static launchid_sample sample[SAMPLES];
static launchid_status answer[SAMPLES];
static launchid_estimate estimate[SAMPLES];
static launchid_state states[SAMPLES];
static launchid_state state;
static launchid_work work;
static uint64_t random_word;

/* xorshift64*, Vigna 2016 */
static uint64_t draw(void)
{
    random_word ^= random_word >> 12;
    random_word ^= random_word << 25;
    random_word ^= random_word >> 27;
    return random_word * UINT64_C(2685821657736338717);
}

static double moved(double now, double was, double std)
{
    return now == was || std != std ? 0.0 : fabs(now - was) / std;
}

static double moved_of(const launchid_estimate *a, const launchid_estimate *b)
{
    const double window = fmax(moved(a->a6, b->a6, b->a6_std), moved(a->k1, b->k1, b->k1_std));
    const double tracked = a->tracked.valid && b->tracked.valid
        ? fmax(moved(a->tracked.a6, b->tracked.a6, b->tracked.a6_std),
               moved(a->tracked.k1, b->tracked.k1, b->tracked.k1_std)) : 0.0;
    return fmax(a->valid && b->valid ? window : 0.0, tracked);
}

/* Damages the state. */
static void damage(const char *kind)
{
    const size_t words = sizeof state / 8U, a = (size_t)(draw() % (words - 1U));
    const size_t b = strcmp(kind, "pair") == 0 ? (size_t)(draw() % words) : a + 1U;
    const uint64_t bit = UINT64_C(1) << (draw() % 64U);
    uint64_t word[sizeof state / 8U];
    memcpy(word, &state, sizeof state);
    if (strcmp(kind, "swap") == 0) {
        const uint64_t kept = word[a];
        word[a] = word[b];
        word[b] = kept;
    } else if (strcmp(kind, "zero") == 0) {
        memset(&word[a], 0, 8U * (words - a < 8U ? words - a : 8U));
    } else {
        word[a] ^= bit;
        if (strcmp(kind, "bit") != 0 && a != b) {
            word[b] ^= bit;
        }
    }
    memcpy(&state, word, sizeof state);
}

/* What becomes of damage before sample `at`; the window that it fell into is number 0. */
static int fate(int at, int n, const char *kind, int *forgotten)
{
    bool flagged = false, same = true;
    double most = 0.0;
    int windows = 0;
    state = states[at];
    damage(kind);
    for (int k = at; k < n; k++) {
        const launchid_status status = launchid_state_update(&state, &work, &sample[k]);
        if (status == LAUNCHID_RECOVERED) {
            return ANEW;
        }
        flagged = flagged || status != answer[k];
        if (status != LAUNCHID_WINDOW_COMPLETE || answer[k] != status) {
            continue;
        }
        launchid_estimate now;
        memset(&now, 0, sizeof now);
        (void)launchid_state_estimate(&state, &work, &now);
        flagged = flagged || now.status != estimate[k].status;
        same = same && memcmp(&now, &estimate[k], sizeof now) == 0;
        most = fmax(most, moved_of(&now, &estimate[k]));
        windows++;
        if (k + 1 < n && memcmp(&state, &states[k + 1], sizeof state) == 0) {
            *forgotten = windows > *forgotten ? windows : *forgotten;
            return FORGOTTEN;
        }
    }
    const launchid_notes a = launchid_state_notes(&state), b = launchid_state_notes(&states[n]);
    if (flagged || memcmp(&a, &b, sizeof a) != 0) {
        return FLAGGED;
    }
    return same ? SAME : most < LITTLE ? MOVED_LITTLE : MORE;
}

int main(int argc, char **argv)
{
    int n = 0, closed = 0, first = 0, last, forgotten = 0;
    long count[CLASSES] = {0};
    random_word = argc > 1 ? strtoull(argv[1], NULL, 10) * 2U + 1U : 1U;
    const long flips = argc > 2 ? strtol(argv[2], NULL, 10) : 1000;
    while (n + 1 < SAMPLES && scanf("%lf %lf %lf %lf %lf %lf %lf", &sample[n].t, &sample[n].theta,
                                    &sample[n].theta_dot, &sample[n].beta, &sample[n].theta_ddot, &sample[n].beta_cmd,
                                    &sample[n].gamma) == 7) {
        n++;
    }
    launchid_state_reset(&state);
    for (int k = 0; k < n; k++) {
        states[k] = state;
        answer[k] = launchid_state_update(&state, &work, &sample[k]);
        if (answer[k] == LAUNCHID_WINDOW_COMPLETE) {
            (void)launchid_state_estimate(&state, &work, &estimate[k]);
            closed++;
        }
    }
    states[n] = state;
    last = n;
    for (int k = n - 1, left = AFTER; k >= 0 && left >= 0; k--) {
        if (answer[k] == LAUNCHID_WINDOW_COMPLETE) {
            last = left == 0 ? last : k;
            first = k + 1;
            left--;
        }
    }
    if (closed < AFTER + 2 || first >= last) {
        fprintf(stderr, "%d windows are too few\n", closed);
        return EXIT_FAILURE;
    }
    for (long k = 0; k < flips; k++) {
        const int at = first + (int)(draw() % (uint64_t)(last - first));
        count[fate(at, n, argc > 3 ? argv[3] : "bit", &forgotten)]++;
    }
    for (int k = 0; k < CLASSES; k++) {
        printf("%s %ld\n", names[k], count[k]);
    }
    printf("windows %d\n", forgotten);
    return EXIT_SUCCESS;
}
