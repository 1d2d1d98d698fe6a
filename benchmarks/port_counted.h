/* Numbers that count what is done with them: `port_operations` compiles an exported launchid.c with them, as C++.

   `real` stands for a double in a variable, `stored` for one in an array or a struct: reading it is a load. */

#ifndef PORT_COUNTED_H
#define PORT_COUNTED_H

#include <cmath>
#include <cstdint>
#include <type_traits>

static struct { int64_t loads, stores, sums, products, quotients, roots; } counted_so_far;

struct real {
    double v;
    real() = default;
    template <class N, class = std::enable_if_t<std::is_arithmetic_v<N> || std::is_enum_v<N>>>
    constexpr real(N x) : v((double)x) {}
    explicit operator int64_t() const { return (int64_t)v; }
};

struct stored {
    double v;
    stored() = default;
    constexpr stored(double x) : v(x) {}
    operator real() const { counted_so_far.loads++; return real(v); }
    explicit operator int64_t() const { return (int64_t)(real)*this; }
    stored &operator=(real x) { counted_so_far.stores++; v = x.v; return *this; }
    template <class N, class = std::enable_if_t<std::is_arithmetic_v<N>>>
    stored &operator=(N x) { return *this = real(x); }
    stored &operator=(const stored &x) { return *this = (real)x; }
    stored(const stored &) = default;
};

#define COUNTED(symbol, what) \
    static inline real operator symbol(real a, real b) { counted_so_far.what++; return real(a.v symbol b.v); } \
    static inline real &operator symbol##=(real &a, real b) { return a = a symbol b; } \
    static inline stored &operator symbol##=(stored &a, real b) { return a = (real)a symbol b; }
COUNTED(+, sums)
COUNTED(-, sums)
COUNTED(*, products)
COUNTED(/, quotients)

#define COMPARED(symbol) static inline bool operator symbol(real a, real b) { return a.v symbol b.v; }
COMPARED(<)
COMPARED(>)
COMPARED(<=)
COMPARED(>=)
COMPARED(==)
COMPARED(!=)

static inline real operator-(real a) { return real(-a.v); }
static inline real sqrt(real a) { counted_so_far.roots++; return real(std::sqrt(a.v)); }
static inline real fabs(real a) { return real(std::fabs(a.v)); }
static inline real floor(real a) { return real(std::floor(a.v)); }
static inline real fmod(real a, real b) { return real(std::fmod(a.v, b.v)); }
static inline real copysign(real a, real b) { return real(std::copysign(a.v, b.v)); }
static inline real frexp(real a, int *power) { return real(std::frexp(a.v, power)); }
static inline real ldexp(real a, int power) { return real(std::ldexp(a.v, power)); }
static inline bool isfinite(real a) { return std::isfinite(a.v); }
static inline bool isinf(real a) { return std::isinf(a.v); }
static inline bool isnan(real a) { return std::isnan(a.v); }

#define new new_  /* names that C leaves free */
#endif
