/* Reads samples on stdin as `replay` does, and after sample number K of each argument saves: FILE K, FILE K, ...
   Then goes on with an estimator that was restored, and prints the statuses; checks that what is wrong is refused. */

#include "launchid.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static launchid_estimator one, other;
static uint8_t saved[LAUNCHID_SAVED_BYTES], again[LAUNCHID_SAVED_BYTES + 1];

static int wrong(const char *what)
{
    fprintf(stderr, "%s\n", what);
    return EXIT_FAILURE;
}

/* Every refusal leaves the state as it is. */
static int refused(void)
{
    static launchid_estimator before;
    before = other;
    for (size_t bytes = 0; bytes < LAUNCHID_SAVED_BYTES; bytes += 97) {
        if (launchid_restore(&other, saved, bytes) != LAUNCHID_SAVED_NOT_WHOLE) {
            return wrong("a truncated state was not refused");
        }
    }
    if (launchid_restore(&other, again, LAUNCHID_SAVED_BYTES + 1) != LAUNCHID_SAVED_NOT_WHOLE) {
        return wrong("a longer state was not refused");
    }
    for (size_t k = 0; k < LAUNCHID_SAVED_BYTES; k += 89) {
        memcpy(again, saved, sizeof saved);
        again[k] = (uint8_t)(again[k] ^ (1U << (k % 8U)));
        if (launchid_restore(&other, again, LAUNCHID_SAVED_BYTES) != LAUNCHID_SAVED_DAMAGED) {
            return wrong("a flipped bit was not refused");
        }
    }
    other.state.busy = LAUNCHID_BUSY_MARK;
    if (launchid_restore(&other, saved, sizeof saved) != LAUNCHID_SAVED_NOT_NOW || launchid_save(&other, again)) {
        return wrong("saved or restored within an update");
    }
    other.state.busy = 0;
    return memcmp(&before, &other, sizeof other) == 0 ? EXIT_SUCCESS : wrong("a refused restore changed the state");
}

int main(int argc, char **argv)
{
    launchid_sample s;
    int number = 0, next = 1;
    launchid_reset(&one);
    while (scanf("%lf %lf %lf %lf %lf %lf %lf", &s.t, &s.theta, &s.theta_dot, &s.beta, &s.theta_ddot, &s.beta_cmd,
                 &s.gamma) == 7) {
        if (next + 1 < argc && number == atoi(argv[next + 1])) {
            if (!launchid_save(&one, saved) || refused() != EXIT_SUCCESS) {
                return EXIT_FAILURE;
            }
            FILE *file = fopen(argv[next], "wb");
            if (file == NULL || fwrite(saved, 1, sizeof saved, file) != sizeof saved || fclose(file) != 0) {
                return wrong("cannot write");
            }
            memset(&other, 0x5A, sizeof other);
            other.state.busy = 0;
            if (launchid_restore(&other, saved, sizeof saved) != LAUNCHID_RESTORED) {
                return wrong("not restored");
            }
            next += 2;
        }
        const launchid_status status = launchid_update(&one, &s);
        if (next > 1 && (launchid_update(&other, &s) != status || !launchid_save(&one, saved)
                         || !launchid_save(&other, again) || memcmp(saved, again, sizeof saved) != 0)) {
            return wrong("goes on otherwise after a restore");
        }
        number++;
    }
    printf("%d restored\n", (next - 1) / 2);
    return EXIT_SUCCESS;
}
