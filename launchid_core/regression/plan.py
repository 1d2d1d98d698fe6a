"""The choices made at construction, as kernels read them, and the places of the series of a window's close."""

from ..kernels import inner

# plan (i8) of a regression
KEEP, TERM_A6, TERM_K1, TERM_A6_DOT, TERM_K1_DOT, MEASURED, INTEGRAL, TERMS_HELD, ENOUGH, SPARSE = range(10)
N_PLAN = 10
# threshold (f8) of a regression: what a term must exceed to stay
RAW, OWN_SHARE = range(2)
N_THRESHOLDS = 2
# option (i8) of the filtered formulation: follow the noise levels; samples below which a window is SHORT
ESTIMATE_LEVELS, LEAST_SAMPLES = range(2)
N_OPTIONS = 2

PAIR = 2  # a6 and k1, and their drifts tau*theta and tau*beta: neighbours in `plan` and in an outcome's numbers

# rows (N_SERIES, m) of a window's close: the ring's columns, and behind them
SLOPE_COLUMN = 7  # 3: derivatives of theta, theta_dot, beta
STATES = 10   # 4: theta, theta_dot, beta, tau
STANDARD = 14  # 4: the same, standardised
WEIGHT = 18   # 4: of the rows around a step in the integral over it
HALF_INTEGRAL = 22  # scratch of the integrals
ROW_ERROR = 23  # by how much the numerical derivative or integral of a row may be off
VALUE = 24    # a library column at every row
N_SERIES = 25
# marks (N_MARKS, m) int64: gap-free piece; 1 where the row may be used; rows kept
SEGMENT, USABLE, KEPT = range(3)
N_MARKS = 3


@inner
def is_active(plan, active, term):
    """Whether a term is in the equation: where nothing selects, all are."""
    return plan[SPARSE] == 0 or active[term] == 1


@inner
def number_active(plan, active, q):
    """How many of q terms are in the equation."""
    if plan[SPARSE] == 0:
        return q
    number = 0
    for j in range(q):
        number += int(active[j] == 1)
    return number
