"""Candidate terms: names, their codes, and a column of the library matrix.

A term is a product of powers of theta, theta_dot, beta and tau (time from the window's centre) and at most one function
of a state, theta^e0 * theta_dot^e1 * beta^e2 * tau^e3 * f(state); its code is the six integers (e0, e1, e2, e3, f,
state).  Standardised samples z = (x - c)/s go back to raw ones by the binomial theorem, term by term: x^e = sum_f
binom(e, f) c^(e-f) s^f z^f, so Phi_raw = Phi_std T with T in closed form (triangular when terms are ordered by degree).

Assumption: centring needs every lower power in the library, otherwise T would leave it; a variable for which that does
not hold is scaled but not centred.
"""

import math
import re

import numpy as np

from ..kernels import inner, kernel
from .elementary import cos_of, sin_of

VARIABLES = ("theta", "theta_dot", "beta", "tau")
N_VARIABLES = 4
TAU = 3
FUNCTIONS = ("", "sin", "cos", "sign")
MAX_POWER = 5   # of one variable in one term: a fifth power of 0.05 rad is below every sensor's noise
MAX_TERMS = 40  # bounds the work of a window's close (a cubic library in three states has 20)
CODE_LENGTH = 6  # e0 e1 e2 e3 function argument

_FACTOR = re.compile(r"(?:(sin|cos|sign)\((theta|theta_dot|beta)\)|(theta_dot|theta|beta|tau)(?:\^(\d+))?)\Z")


def polynomial(order: int) -> tuple[str, ...]:
    """Names of all monomials in theta, theta_dot, beta up to `order`, by degree.

    `polynomial(2)` are the ten terms of Navarro-Tapia et al., section 4.1.
    Raises ValueError outside 0..MAX_POWER.
    """
    if not isinstance(order, int) or not 0 <= order <= MAX_POWER:
        raise ValueError(f"polynomial order {order!r}: expected an integer in 0..{MAX_POWER}")
    names = []
    for degree in range(order + 1):
        for i in range(degree, -1, -1):
            for j in range(degree - i, -1, -1):
                names.append(term_name((i, j, degree - i - j, 0, 0, 0)))
    return tuple(names)


def term_name(code: tuple[int, ...]) -> str:
    """Canonical name of a code: `tau` first, then theta, theta_dot, beta, then the function."""
    factors = []
    for variable in (TAU, 0, 1, 2):
        power = code[variable]
        if power:
            factors.append(VARIABLES[variable] + (f"^{power}" if power > 1 else ""))
    if code[4]:
        factors.append(f"{FUNCTIONS[code[4]]}({VARIABLES[code[5]]})")
    return "*".join(factors) or "1"


def parse_term(name: str) -> tuple[int, ...]:
    """Code of a term by name, such as ``theta*theta_dot`` or ``tau*sin(theta)``; ValueError if it is none."""
    code = [0] * CODE_LENGTH
    text = name.replace(" ", "")
    if text == "1":
        return tuple(code)
    for factor in text.split("*"):
        match = _FACTOR.match(factor)
        if match is None:
            raise ValueError(
                f"library term {name!r}: {factor!r} is no factor; expected 1, theta, theta_dot, beta, tau, "
                "a power such as theta^2, or sin(..), cos(..), sign(..) of a state")
        function, argument, variable, power = match.groups()
        if function:
            if code[4]:
                raise ValueError(f"library term {name!r}: at most one function in a term")
            code[4], code[5] = FUNCTIONS.index(function), VARIABLES.index(argument)
        else:
            code[VARIABLES.index(variable)] += int(power or 1)
    if max(code[:4]) > MAX_POWER:
        raise ValueError(f"library term {name!r}: powers up to {MAX_POWER} are supported")
    return tuple(code)


LIBRARIES = {
    "rigid-body": ("theta", "beta"),
    "linear": ("1", "theta", "theta_dot", "beta"),
    "quadratic": polynomial(2),
    "quadratic+sin": (*polynomial(2), "sin(theta)"),
    "lpv": ("theta", "beta", "tau*theta", "tau*beta"),
}


def library_terms(library: str | tuple[str, ...]) -> tuple[str, ...]:
    """Canonical names of a library given by name, by comma list, or as a tuple of terms.

    Raises ValueError for an unknown term, a repeated one, none, or more than MAX_TERMS.
    """
    if isinstance(library, str):
        names = LIBRARIES.get(library) or tuple(library.split(","))
    else:
        names = tuple(library)
    try:
        terms = tuple(term_name(parse_term(name)) for name in names)
    except ValueError as error:
        raise ValueError(f"library {library!r}: {error}; or a library by name: {', '.join(LIBRARIES)}") from None
    if not 1 <= len(terms) <= MAX_TERMS:
        raise ValueError(f"library {library!r}: {len(terms)} terms; expected 1..{MAX_TERMS}")
    for name in terms:
        if terms.count(name) > 1:
            raise ValueError(f"library {library!r}: term {name!r} stands twice")
    return terms


OWN_PART = 0.005  # of the rms acceleration that a term must explain by itself: well below any term of the paper's


def default_own_share(terms: tuple[str, ...]) -> float:
    """Share of the acceleration's squares that a term must explain by itself; 0 (no term is left out) for libraries
    inside `lpv`, where the slopes explain little over a short window and all four terms are the vehicle's."""
    return 0.0 if set(terms) <= set(LIBRARIES["lpv"]) else OWN_PART**2


def term_codes(terms: tuple[str, ...]) -> np.ndarray:
    """Codes (q, 6) int64 of the terms."""
    return np.array([parse_term(name) for name in terms], dtype=np.int64).reshape(len(terms), CODE_LENGTH)


def centred_variables(codes: np.ndarray) -> np.ndarray:
    """(4,) int64: 1 where the library holds all lower powers, so that the variable may be centred.

    tau is centred by definition and stays as it is.
    """
    present = {tuple(code) for code in codes.tolist()}
    centred = np.zeros(N_VARIABLES, dtype=np.int64)
    for variable in range(TAU):
        lower = [tuple(p - 1 if k == variable else p for k, p in enumerate(code))
                 for code in present if code[variable] > 0]
        used = any(code[variable] > 0 for code in present)
        centred[variable] = int(used and all(code in present for code in lower))
    return centred


BINOMIAL = np.array([[math.comb(n, k) for k in range(MAX_POWER + 1)] for n in range(MAX_POWER + 1)], dtype=np.float64)


@kernel
def function_value(function, x):
    """Value of function number `function` (index into FUNCTIONS) at x; 1 for none, sign(0) = 0."""
    if function == 1:
        return sin_of(x)
    if function == 2:
        return cos_of(x)
    if function == 3:
        return 1.0 if x > 0.0 else (-1.0 if x < 0.0 else 0.0)
    return 1.0


@inner
def library_column(code, z, argument, n, column):
    """A term's column (>=n,) out of the standardised library matrix Phi_std.

    z (4, >=n) in  standardised variables, bases of powers
    argument (>=n,) in  what its function, if it has one, is of, as measured
    """
    for i in range(n):
        column[i] = 1.0
    for v in range(N_VARIABLES):
        if code[v] > 0:
            base = z[v]
            for i in range(n):
                value = base[i]
                for _ in range(1, code[v]):
                    value *= base[i]
                column[i] *= value
    if code[4] > 0:
        for i in range(n):
            column[i] *= function_value(code[4], argument[i])


@inner
def raw_from_standard(codes, centre, scale, tt):
    """T of Phi_raw = Phi_std T, by the binomial theorem.

    codes  (q, 6)  in
    centre (4,)    in    c; 0 where the variable is not centred
    scale  (4,)    in    s > 0
    tt     (q, q)  out   T transposed: tt[i, j] is the share of standardised term j in raw term i
    """
    q = codes.shape[0]
    for i in range(q):
        for j in range(q):
            value = 1.0 if codes[i, 4] == codes[j, 4] and codes[i, 5] == codes[j, 5] else 0.0
            for v in range(N_VARIABLES):
                e, f = codes[i, v], codes[j, v]
                for _ in range(e - f):
                    value *= centre[v]
                for _ in range(f):
                    value *= scale[v]
                value *= BINOMIAL[e, f]  # 0 where a power is lower
            tt[i, j] = value
