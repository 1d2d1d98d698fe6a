/* SPDX-License-Identifier: Apache-2.0; see launchid.h.  In brackets above a function: its module in launchid_core. */

#include "launchid.h"

#include <float.h>
#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

/* Options that take NaN and infinities for what never is, or sum in another order, would give other answers. */
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ != 0))
#error "expected NaN and infinities: no -ffast-math, no -ffinite-math-only"
#endif
#if defined(__ASSOCIATIVE_MATH__) || defined(__RECIPROCAL_MATH__) || defined(__NO_SIGNED_ZEROS__)
#error "expected every operation as it is written: no -funsafe-math-optimizations and none of its parts"
#endif
#if defined(FLT_EVAL_METHOD) && (FLT_EVAL_METHOD != 0)
#error "expected plain double precision: no wider intermediate results (-mfpmath=sse on x87 machines)"
#endif
#if defined(DBL_MANT_DIG) && (DBL_MANT_DIG != 53)
#error "expected doubles of 64 bits (IEEE 754)"
#endif
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#pragma clang fp reassociate(off)
#elif defined(__GNUC__)
#pragma GCC optimize("fp-contract=off")
#else
#pragma STDC FP_CONTRACT OFF
#endif

/* ---- arrays, and what C does otherwise than Python */

$arrays
typedef union { double number; int64_t word; } Bits;

static inline double max_double(double a, double b) { return (b > a) ? b : a; }

static inline double min_double(double a, double b) { return (b < a) ? b : a; }

static inline int64_t max_integer(int64_t a, int64_t b) { return (b > a) ? b : a; }

static inline int64_t min_integer(int64_t a, int64_t b) { return (b < a) ? b : a; }

static inline double as_real(int64_t n) { return (double)n; }

static inline int64_t as_whole(double x) { return (int64_t)x; }

static inline int64_t counted(bool yes)
{
    int64_t n = 0;
    if (yes) {
        n = 1;
    }
    return n;
}

/* a % b of Python for b > 0: never negative. */
static inline int64_t modulo(int64_t a, int64_t b)
{
    const int64_t rest = a % b;
    return (rest < 0) ? (rest + b) : rest;
}

/* a divided by b > 0 as Python rounds it: towards minus infinity. */
static inline int64_t quotient(int64_t a, int64_t b)
{
    return ((a % b) < 0) ? ((a / b) - 1) : (a / b);
}

/* A seal of what is to stay as it is, with another word, turned to the left by its place. */
static inline int64_t seal_integer(int64_t seal, int64_t n, int64_t place)
{
    const uint64_t bits = (uint64_t)n;
    const uint64_t turn = (uint64_t)place & 63U;
    const uint64_t turned = (bits << turn) | (bits >> ((64U - turn) & 63U));
    const uint64_t both = (uint64_t)seal ^ turned;
    return (int64_t)both;
}

static inline int64_t seal_double(int64_t seal, double x, int64_t place)
{
    const Bits bits = {.number = x};
    return seal_integer(seal, bits.word, place);
}

/* A step of the generator xorshift64. */
static inline int64_t mixed(int64_t seal)
{
    uint64_t bits = (uint64_t)seal;
    bits ^= bits << 13U;
    bits ^= bits >> 7U;
    bits ^= bits << 17U;
    return (int64_t)bits;
}

/* x as a fraction from 0.5 to 1 times a power of two. */
static inline double fraction_of(double x)
{
    int power = 0;
    return frexp(x, &power);
}

static inline int64_t exponent_of(double x)
{
    int power = 0;
    (void)frexp(x, &power);
    return (int64_t)power;
}

/* x 2^n, rounded once. */
static inline double scaled(double x, int64_t n)
{
    return ldexp(x, (int)n);
}
