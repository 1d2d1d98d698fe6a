#include "launchid.h"

#include <float.h>
#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#if defined(__FAST_MATH__) || (defined(FLT_EVAL_METHOD) && FLT_EVAL_METHOD != 0)
#error "expected plain double precision: no -ffast-math, no wider intermediate results (-mfpmath=sse on x87 machines)"
#endif

/* ---- arrays, and what C does otherwise than Python */

typedef struct { double *p; int64_t n; } Vector;
typedef struct { double *p; int64_t n, m; } Matrix;
typedef struct { double *p; int64_t n, m, k; } Cube;
typedef struct { int64_t *p; int64_t n; } Integers;
typedef struct { int64_t *p; int64_t n, m; } IntegerMatrix;
typedef struct { bool *p; int64_t n; } Truths;
typedef struct { bool *p; int64_t n, m; } TruthMatrix;

static inline double max_double(double a, double b) { return b > a ? b : a; }
static inline double min_double(double a, double b) { return b < a ? b : a; }
static inline int64_t max_integer(int64_t a, int64_t b) { return b > a ? b : a; }
static inline int64_t min_integer(int64_t a, int64_t b) { return b < a ? b : a; }

/* a % b of Python: with the sign of b. */
static inline int64_t modulo(int64_t a, int64_t b)
{
    const int64_t rest = a % b;
    return rest != 0 && (rest < 0) != (b < 0) ? rest + b : rest;
}

/* Exclusive or of words: seals of what is to stay as it is. */
static inline int64_t xor_integer(int64_t a, int64_t b)
{
    return (int64_t)((uint64_t)a ^ (uint64_t)b);
}

static inline int64_t xor_double(int64_t seal, double x)
{
    int64_t word;
    memcpy(&word, &x, sizeof word);
    return xor_integer(seal, word);
}

/* a // b of Python: towards minus infinity. */
static inline int64_t quotient(int64_t a, int64_t b)
{
    return a / b - (a % b != 0 && (a < 0) != (b < 0));
}

