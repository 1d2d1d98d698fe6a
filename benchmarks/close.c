/* What a window's close costs in plain C: 100 rows x ten terms, the regression alone.

   Standardised quadratic terms, columns of unit norm, Householder QR with column pivoting, the way back to raw terms, and
   sequentially thresholded least squares of three equations; no interval, no limit of what is absent.  Reads rows of
   theta, theta_dot, beta and the three slopes from stdin; prints a6, k1 and then REPEATS times [ns]. */

#define _POSIX_C_SOURCE 199309L

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define M 100
#define Q 10
#define E 3
#define THRESHOLD 0.5

static const int power[Q][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {2, 0, 0},
                                {1, 1, 0}, {1, 0, 1}, {0, 2, 0}, {0, 1, 1}, {0, 0, 2}};
static double state[M][3], slope[M][E];

static double dot(const double *restrict a, const double *restrict b, int n)
{
    double s = 0.0;
    for (int i = 0; i < n; i++) {
        s += a[i] * b[i];
    }
    return s;
}

static void reflect(const double *restrict v, double tau, double *restrict y, int n)
{
    const double s = tau * (y[0] + dot(&v[1], &y[1], n - 1));
    y[0] -= s;
    for (int i = 1; i < n; i++) {
        y[i] -= s * v[i];
    }
}

/* Columns of `a` (n of length m) scaled to unit norm and factored. */
static void factor(double *a, int n, int m, int *order, double *tau, double *norm)
{
    for (int j = 0; j < n; j++) {
        double *const c = &a[j * m];
        order[j] = j;
        norm[j] = sqrt(dot(c, c, m));
        for (int i = 0; i < m; i++) {
            c[i] /= norm[j];
        }
    }
    for (int k = 0; k < n; k++) {
        int best = k;
        double most = -1.0;
        for (int j = k; j < n; j++) {
            const double square = dot(&a[j * m + k], &a[j * m + k], m - k);
            if (square > most) {
                most = square;
                best = j;
            }
        }
        if (best != k) {
            double keep[M];
            memcpy(keep, &a[k * m], sizeof(double) * (size_t)m);
            memcpy(&a[k * m], &a[best * m], sizeof(double) * (size_t)m);
            memcpy(&a[best * m], keep, sizeof(double) * (size_t)m);
            const int number = order[k];
            order[k] = order[best];
            order[best] = number;
        }
        double *const v = &a[k * m + k];
        const double beta = -copysign(sqrt(most), v[0]);
        tau[k] = (beta - v[0]) / beta;
        const double inverse = 1.0 / (v[0] - beta);
        for (int i = 1; i < m - k; i++) {
            v[i] *= inverse;
        }
        v[0] = beta;
        for (int j = k + 1; j < n; j++) {
            reflect(v, tau[k], &a[j * m + k], m - k);
        }
    }
}

/* Coefficients of one equation from M (columns of length Q) and Q'y. */
static void thresholded(double mt[Q][Q], const double *y, double *xi)
{
    int active[Q], left = Q + 1;
    for (int j = 0; j < Q; j++) {
        active[j] = 1;
    }
    while (left > 0) {
        double a[Q * Q], tau[Q], norm[Q], right[Q], x[Q];
        int order[Q], place[Q], n = 0, cut = 0;
        memset(xi, 0, Q * sizeof *xi);
        for (int j = 0; j < Q; j++) {
            if (active[j]) {
                memcpy(&a[n * Q], mt[j], sizeof mt[j]);
                place[n++] = j;
            }
        }
        factor(a, n, Q, order, tau, norm);
        memcpy(right, y, sizeof right);
        for (int k = 0; k < n; k++) {
            reflect(&a[k * Q + k], tau[k], &right[k], Q - k);
        }
        for (int k = n - 1; k >= 0; k--) {
            double s = right[k];
            for (int j = k + 1; j < n; j++) {
                s -= a[j * Q + k] * x[j];
            }
            x[k] = s / a[k * Q + k];
            xi[place[order[k]]] = x[k] / norm[order[k]];
        }
        for (int j = 0; j < Q; j++) {
            if (active[j] && fabs(xi[j]) < THRESHOLD) {
                active[j] = 0;
                cut++;
            }
        }
        left = cut > 0 ? left - 1 : 0;
    }
}

/* (c + s z)^n as the share of z^f */
static double share(int n, int f, double c, double s)
{
    static const double binomial[3][3] = {{1.0, 0.0, 0.0}, {1.0, 1.0, 0.0}, {1.0, 2.0, 1.0}};
    return f > n ? 0.0 : binomial[n][f] * pow(c, n - f) * pow(s, f);
}

static void close_window(double xi[E][Q])
{
    double centre[3] = {0}, scale[3] = {0}, phi[Q * M], mt[Q][Q], tau[Q], norm[Q];
    int order[Q];
    for (int v = 0; v < 3; v++) {
        for (int i = 0; i < M; i++) {
            centre[v] += state[i][v] / M;
        }
        for (int i = 0; i < M; i++) {
            scale[v] += (state[i][v] - centre[v]) * (state[i][v] - centre[v]) / M;
        }
        scale[v] = sqrt(scale[v]);
    }
    for (int i = 0; i < M; i++) {
        const double a = (state[i][0] - centre[0]) / scale[0], b = (state[i][1] - centre[1]) / scale[1],
                     c = (state[i][2] - centre[2]) / scale[2];
        const double row[Q] = {1.0, a, b, c, a * a, a * b, a * c, b * b, b * c, c * c};
        for (int j = 0; j < Q; j++) {
            phi[j * M + i] = row[j];
        }
    }
    factor(phi, Q, M, order, tau, norm);
    for (int i = 0; i < Q; i++) {
        double of[Q];
        for (int j = 0; j < Q; j++) {
            of[j] = norm[j];
            for (int v = 0; v < 3; v++) {
                of[j] *= share(power[i][v], power[j][v], centre[v], scale[v]);
            }
        }
        for (int r = 0; r < Q; r++) {
            mt[i][r] = 0.0;
            for (int k = r; k < Q; k++) {
                mt[i][r] += phi[k * M + r] * of[order[k]];
            }
        }
    }
    for (int e = 0; e < E; e++) {
        double y[M];
        for (int i = 0; i < M; i++) {
            y[i] = slope[i][e];
        }
        for (int k = 0; k < Q; k++) {
            reflect(&phi[k * M + k], tau[k], &y[k], M - k);
        }
        thresholded(mt, y, xi[e]);
    }
}

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

int main(int argc, char **argv)
{
    const int repeats = argc > 1 ? atoi(argv[1]) : 1;
    double xi[E][Q];
    for (int i = 0; i < M; i++) {
        if (scanf("%lf %lf %lf %lf %lf %lf", &state[i][0], &state[i][1], &state[i][2], &slope[i][0], &slope[i][1],
                  &slope[i][2]) != 6) {
            return 1;
        }
    }
    close_window(xi);
    printf("%.17g %.17g\n", xi[1][1], xi[1][3]);
    for (int k = 0; k < repeats; k++) {
        const double begin = now();
        close_window(xi);
        printf("%.0f\n", now() - begin);
    }
    return 0;
}
