"""The memory of an estimator in one table: a line an array or a number, with name, type, shape and meaning.

Shapes are fixed maxima, as flight software has them, so that no choice of a user makes a kernel compile again; how much
of an array is in use stands in `Size`; of what is sealed the rest stays zero.  What grows with the window, the sample
rate or a profile's nodes stands apart, in arrays of its own (`SEPARATE_ARRAYS`).  In a saved state and in C every
array has the extents in use alone.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..algebra.library import CODE_LENGTH, MAX_TERMS, N_VARIABLES
from ..filter import states as sx
from ..filter import whiteness as wh
from ..filter.known import N_COMMAND_PATH, N_KNOWN_NODE, N_SLOPES
from ..filter.modes import N_NOW, N_OWN
from ..filter.servo import N_SERVO
from ..gate import ring as rb
from ..gate.stuck import N_WATCHED
from ..gate.window import EQUATIONS
from ..model import MAX_KNOWN, MAX_LEVELS, MAX_MODES, MAX_NUISANCES, MAX_NUMBERS, N_OFFSETS
from ..regression.rows import N_MARKS, N_SERIES, PAIR
from ..watch import changes as ch
from ..watch import undeclared as un
from ..watch.tracker import MEMBERS
from ..watch.uncertainty import OUT

F8 = np.dtype(np.float64)
I8 = np.dtype(np.int64)
FIXED = "fixed"  # never changes in flight
STATE = "state"  # persists between samples
WORK = "work"    # scratch


class Size(NamedTuple):
    """The sizes of the memory in use: integers that never change."""

    terms: int          # of the library
    theta: int          # place of theta among them
    beta: int           # and of beta
    states: int         # of the filter
    nuisances: int      # of them beyond the vehicle's
    levels: int         # noise levels
    rigid_numbers: int  # the modes' unknown numbers, a6 and k1; 0 where all are known
    servo: int          # numbers of the servo that are not known; 0 where all are
    responses: int      # of the servo: its own, and one for each of those numbers; 0 where all are known
    sensitivities: int  # columns of the filter's: offset at the block's start, terms, servo, modes' numbers, tests
    servo_at: int       # the first of the servo's
    columns: int        # the same and the right-hand side
    pair: int           # columns of a block reduced to offset, theta, beta, right-hand side
    wider: int          # columns of a regression: terms, equations, drifts of a6 and k1
    modes: int          # of slosh and bending, two states each
    sloshes: int        # of them the first
    mode_at: int        # the first of their states
    acting: int         # states that act on theta: all but those of bending, which are the last
    numbers: int        # of theirs that are not known
    number_at: int      # the first column of sensitivities for them
    swept: int          # 1: their numbers change with time
    shows: int          # 1: sensors show more than a channel and its offset
    known: int          # 1: accelerations are known beside those of a6 and k1
    known_terms: int    # terms among them
    sines: int          # sines of time among them
    shaped: int         # 1: play, lag or wash-out lie between command and servo
    learned: int        # columns of the structure's information, right-hand side last
    gust: int           # states of the gust after calm; 0 of a model without nuisances
    undeclared: int     # states of the undeclared wind; 0 of a model with nuisances, which knows better
    integral: int       # 1: formulation `integral`
    solver: int         # index into SOLVERS
    by_share: int       # 1: a term stays by what it explains by itself, not by a threshold
    structured: int     # 1: more terms than theta and beta, of which it is learned which are there
    ranged: int         # 1: the model has a range, so there is an uncertainty level


def size_of(terms: int, nuisances: int = 0, levels: int = 0, servo: int = 0, theta: int = 0, beta: int = 0,
            known: tuple[int, int, int, int] = (0, 0, 0, 0), modes: tuple[int, int, int, int, int] = (0, 0, 0, 0, 0),
            **flags: int) -> Size:
    """Size of an estimator, without levels a regression's.

    known, modes  of `Model`: known, mode_counts;  flags: the last five fields, 0 where absent
    """
    mode_count, sloshes, numbers, swept, shows = modes
    states = sx.N_STATES + nuisances + 2 * mode_count if levels else 0
    sensitivities = states + terms + servo + numbers + sx.N_TESTS
    is_known = levels > 0 and nuisances == 0
    return Size(terms=terms, theta=theta, beta=beta, states=states, nuisances=nuisances, levels=levels,
                rigid_numbers=numbers + 2 if numbers else 0, servo=servo, responses=servo + 1 if servo else 0,
                sensitivities=sensitivities, servo_at=states + terms, columns=sensitivities + 1, pair=states + 3,
                wider=terms + EQUATIONS + PAIR, modes=mode_count, sloshes=sloshes,
                mode_at=sx.N_STATES + nuisances if levels else 0,
                acting=states - 2 * (mode_count - sloshes) if levels else 0, numbers=numbers,
                number_at=states + terms + servo, swept=swept, shows=shows, known=known[0],
                known_terms=known[1], sines=known[2], shaped=known[3], learned=terms + 1,
                gust=states + 2 if nuisances else 0,
                undeclared=un.UNDECLARED_SIZE if is_known else 0,
                **(dict.fromkeys(("integral", "solver", "by_share", "structured", "ranged"), 0) | flags))


def largest_size(with_modes: bool) -> Size:
    """Return the extents of every record: what has no modes pays nothing for them."""
    modes = (2 * MAX_MODES, MAX_MODES, MAX_NUMBERS, 1, 1) if with_modes else (0, 0, 0, 0, 1)
    size = size_of(MAX_TERMS, MAX_NUISANCES, MAX_LEVELS, N_SERVO, known=(1, MAX_KNOWN, MAX_KNOWN, 1), modes=modes)
    return size._replace(undeclared=un.UNDECLARED_SIZE, modes=max(size.modes, 1), numbers=max(size.numbers, 1),
                         rigid_numbers=max(size.rigid_numbers, 3))


LARGEST_SIZE = largest_size(False)


Extent = int | str | tuple["Extent", ...]  # a number, a name of `Size`, the product of several


@dataclass(frozen=True)
class Line:
    """One array, one number (an array of shape ()), or one struct in another."""

    name: str
    kind: "np.dtype[Any] | Struct"
    shape: tuple[Extent, ...] = ()
    about: str = ""

    @property
    def is_number(self) -> bool:
        return not (self.shape or isinstance(self.kind, Struct))


@dataclass(frozen=True, eq=False)
class Struct:
    """A group of arrays, compared by identity so that caches can hash it."""

    name: str
    about: str
    lines: tuple[Line, ...]


def struct(name: str, about: str, *rows: tuple[Any, ...]) -> Struct:
    """A struct of rows (name, type, shape, meaning), or (name, struct)."""
    return Struct(name, about, tuple(Line(*row) for row in rows))


# ---- the table

SIZE = struct("Size", "How much of the memory is in use.", *((name, I8) for name in Size._fields))

OUTCOME = struct(
    "Outcome", "Result of the last window.",
    ("a6", F8, (), "1/s^2; as all numbers of an outcome NaN where it is not known"),
    ("k1", F8, (), "1/s^2"),
    ("a6_std", F8, (), "standard deviation of a6"),
    ("k1_std", F8, (), "and of k1"),
    ("correlation", F8, (), "of both"),
    ("a6_dot", F8, (), "1/s^3, coefficient of tau*theta"),
    ("k1_dot", F8, (), "1/s^3, of tau*beta"),
    ("a6_bound", F8, (), "Cramer-Rao bound of a6 as a standard deviation"),
    ("k1_bound", F8, (), "and of k1"),
    ("condition", F8, (), "of the library, or of a6 and k1"),
    ("whiteness", F8, (), "p-value of the innovations, were the model true"),
    ("status", I8, (), "EstimateStatus"),
    ("used", I8, (), "rows"),
    ("gaps", I8, (), "inside the window"),
    ("xi", F8, ("terms", EQUATIONS), "coefficients"),
    ("support", I8, ("terms", EQUATIONS), "1: active"),
    ("std", F8, ("terms",), "standard deviation of a term of theta_ddot that is active; NaN for those that are not"),
    ("absent", F8, ("terms",), "95 % limit of a term of theta_ddot that is not active; NaN for those that are"))

SPARSE_WORK = struct(
    "SparseWork", "Scratch of the solvers for q terms.",
    ("rows", F8, ((4, "terms", "terms"),), "factor of the active columns, as `sparse` has it"),
    ("order", I8, ("terms",), "terms of its diagonal, behind them those that left"),
    ("norms", F8, ("terms",), "of the columns"),
    ("columns", F8, ((2, "terms", "terms"),), "to factor, one after the other; 2q rows each for SR3's system"),
    ("tau", F8, ("terms",), "Householder factors"),
    ("right", F8, ((2, "terms"),), "right-hand side of SR3's system"),
    ("solution", F8, ("terms",), "of SR3's system, in pivoted order, or of the lasso"),
    ("scaled", F8, (("terms", "terms"),), "columns of unit norm, one after the other"),
    ("weight", F8, ("terms",), "their norms; variances of the active coefficients"),
    ("auxiliary", F8, ("terms",), "residual of the lasso, thresholded coefficients of SR3"))

WHOLE = struct(
    "Whole", "Factor of all columns of M, scaled.",
    ("rows", F8, ((4, "terms", "terms"),), "as `sparse` has it"),
    ("order", I8, ("terms",), "of the pivots"),
    ("tau", F8, ("terms",), "Householder factors"),
    ("norms", F8, ("terms",), "of the columns"))

LIMITS = struct(
    "Limits", "What the gate and the windows compare with.",
    ("period", F8, (), "between two samples [s]"),
    ("window", F8, (), "length of a window [s]"),
    ("max_gap", F8, (), "between two samples, beyond which data are missing [s]"),
    ("largest", F8, (rb.N_COLUMNS,), "amount of a ring column that is no fault"))

PLAN = struct(
    "Plan", "What is chosen of a regression; places are -1 where the term is not in the library.",
    ("keep", I8, (), "rows of a window at most"),
    ("term", I8, (PAIR,), "places of theta and beta"),
    ("slope", I8, (PAIR,), "places of tau*theta and tau*beta"),
    ("measured", I8, (), "1: theta_ddot is measured"),
    ("held", I8, (), "1: beta stays from each row to the next"),
    ("enough", I8, (), "rows below which a window is SHORT"),
    ("sparse", I8, (), "1: terms may leave"))

THRESHOLD = struct(
    "Threshold", "What a term must exceed to stay; one of them is 0.",
    ("raw", F8, (), "in units of each coefficient"),
    ("own_share", F8, (), "of the squares"))

REGRESSION_FIXED = struct(
    "Fixed", "Never changes in flight.",
    ("size", SIZE),
    ("limits", LIMITS),
    ("codes", I8, ("terms", CODE_LENGTH), "terms"),
    ("centred", I8, (N_VARIABLES,), "variables that may be centred"),
    ("plan", PLAN),
    ("threshold", THRESHOLD),
    ("saturation", F8, (rb.N_COLUMNS,), "end stops by ring column"))

CLOCK = struct(
    "Clock", "Stamps [s] and turns that the gate and the windows go by.",
    ("first", F8, (), "sample of all"),
    ("last", F8, (), "sample"),
    ("candidate", F8, (), "newest stamp of a clock that may have been set back"),
    ("closed", F8, (), "begin of the window that just closed"),
    ("turned", F8, (), "whole turns added to theta [rad]"),
    ("before", F8, (), "the last theta as it was measured [rad]"))

COUNTS = struct(
    "Counts", "Where samples go, and how often each status was answered.",
    ("head", I8, (), "row of the ring that the next sample gets"),
    ("rows", I8, (), "of the current window"),
    ("closed_rows", I8, (), "of the closed one"),
    ("closed_back", I8, (), "newest rows of the ring that are not its own"),
    ("started", I8, (), "1: there was a sample"),
    ("index", I8, (), "of the current window"),
    ("candidates", I8, (), "stamps that agree on an earlier clock"),
    ("waiting", I8, (), "samples in the ring that were not used yet"),
    ("estimates", I8, (), "1: a window has closed"),
    ("stuck", I8, (), "windows with a sensor that stood still"),
    ("wraps", I8, (), "jumps of theta across +-pi that were undone"),
    ("answers", I8, (rb.N_STATUS,), "by status - BUSY"))

GUARD = struct(
    "Guard", "Seals beside those of the rows.",
    ("control", I8, (), "of clock and counts"),
    ("carried", I8, (), "of what is carried on"))

REPEATS = struct(
    "Repeats", "Learned of theta, theta_dot, beta.",
    ("share", F8, (N_WATCHED,), "of repeats"),
    ("step", F8, (N_WATCHED,), "smallest between neighbours, 0 before there was one"))

GATE = (
    ("clock", CLOCK),
    ("counts", COUNTS),
    ("guard", GUARD),
    ("outcome", OUTCOME))

REGRESSION_STATE = struct(
    "State", "What persists between samples.",
    *GATE,
    ("random", I8, (), "state of the generator of the row choice"),
    ("repeats", REPEATS))

REGRESSION_WORK = struct(
    "Work", "Scratch of a window's close.",
    ("centre", F8, (N_VARIABLES,), "means of theta, theta_dot, beta, tau"),
    ("scale", F8, (N_VARIABLES,), "their root mean square deviations"),
    ("order", I8, ("terms",), "pivots of the window's factor"),
    ("tau", F8, ("terms",), "its Householder factors"),
    ("norms", F8, ("terms",), "norms of its columns"),
    ("tt", F8, ("terms", "terms"), "T transposed: raw terms from standardised ones"),
    ("mt", F8, ("terms", "terms"), "columns of M as rows"),
    ("xi", F8, ("terms",), "coefficients of one equation"),
    ("active", I8, ("terms",), "its support"),
    ("whole", WHOLE),
    ("sparse", SPARSE_WORK),
    ("drift_order", I8, (PAIR,), "pivots of what the drifts add to the active terms"),
    ("drift_tau", F8, (PAIR,), "its Householder factors"),
    ("drift_norms", F8, (PAIR,), "norms of the drifts"),
    ("drift_value", F8, (PAIR,), "their coefficients, in pivoted order"),
    ("heads", F8, (PAIR, "terms"), "of the drifts: what the library explains of them"),
    ("head", F8, ("terms",), "of a series"),
    ("change", F8, ("terms",), "of each coefficient where a6 and k1 may drift"),
    ("numeric", F8, ("terms",), "of each, squared: what quadrature, differencing and rounding may be off"),
    ("lost", F8, ("terms",), "what the residual loses to an absent term"),
    ("length", F8, ("terms",), "of what an absent term adds to the active ones"))

CONSTANT = struct(
    "Constant", "What is known of vehicle, servo, sensors and air.",
    ("frequency", F8, (), "of the servo, natural [rad/s]"),
    ("damping", F8, (), "of the servo, ratio"),
    ("time_constant", F8, (), "of a servo of first order [s]; 0: it is of second"),
    ("delay", F8, (), "from a command to the servo [s]"),
    ("controller_period", F8, (), "s"),
    ("missing", F8, (), "share of the time between two samples with a command that no sample holds"),
    ("held", F8, (), "1: the gains are the nominal's, whatever is believed of a6 and k1 (a model with wind levels)"),
    ("airy", F8, (), "1: there is a forecast, a drift or a known acceleration in time"),
    ("turbulence_time", F8, (), "s"),
    ("gamma_std", F8, (), "of a measured flight-path angle [rad]"),
    ("lean", F8, (), "thrust misalignment [rad]"),
    ("gyro_scale", F8, (), "factor of theta_dot"),
    ("command_gain", F8, (), "factor of the command"),
    ("command_offset", F8, (), "rad"),
    ("offset", F8, (sx.N_CHANNELS,), "of theta, theta_dot, beta"),
    ("saturation", F8, (sx.N_CHANNELS,), "end stops of theta, theta_dot, beta; inf: none"),
    ("aero_damping", F8, (), "of theta_dot [1/s]"),
    ("a6_drift", F8, (), "one sigma of the slope of a6, relative [1/s]; 0: it has none"),
    ("k1_drift", F8, (), "the same of k1"),
    ("block_share", F8, (), "length of a block over `filtered.BLOCK`: 1 but for whole samples"))

BELIEF = struct(
    "Belief", "What the filter believes, fixed at construction.",
    ("size", SIZE),
    ("constant", CONSTANT),
    ("variance", F8, ("levels",), "declared noises, order of Model.levels"),
    ("prior", F8, ("levels",), "of their logarithms, 1/variance"),
    ("spread", F8, ("nuisances",), "standard deviation of each nuisance at the first sample"),
    ("codes", I8, ("terms", CODE_LENGTH), "library terms"),
    ("slopes", F8, (len(MEMBERS), 2), "one sigma of those of a6 and k1 in each member of the tracker, relative [1/s]"),
    ("servo", F8, ("servo",), "one sigma of what is not known of it: relative frequency, relative damping, delay [s]"),
    ("inertia", F8, (), "c of theta_ddot += c beta_ddot"),
    ("number", I8, ("numbers",), "what of a mode each unknown number is: BY_FREQUENCY, BY_SIZE, BY_DAMPING"),
    ("mode_of", I8, ("numbers",), "and of which"),
    ("number_sigma", F8, ("numbers",), "one sigma of it before the flight, relative"),
    ("known_codes", I8, ("known_terms", CODE_LENGTH), "terms that are known to act"),
    ("known_coefficient", F8, ("known_terms",), "of each"),
    ("sines", F8, ("sines", 3), "known to act: amplitude [rad/s^2], frequency [rad/s], phase [rad]"),
    ("cubic", F8, (), "a6 alpha is known to be a6 (alpha + cubic alpha^3), 1/rad^2"),
    ("rate_limit", F8, (), "of the servo [rad/s]; 0: none"),
    ("rate_reach", F8, (), "that its own rate may run to"),
    ("command", F8, (N_COMMAND_PATH,), "HALF_WIDTH, LAG, WASHOUT"),
    ("role", I8, ("nuisances",), "what each nuisance is, model.WALK .. NOZZLE_BIAS"),
    ("level", I8, ("nuisances",), "its place among the noise levels, or NONE"),
    ("partner", I8, (sx.N_CHANNELS,), "state that each channel shows beside its own, its offset's, or NONE"))

UNKNOWN_SERVO = struct(
    "UnknownServo", "What is known of the servo, as deviations from the nominal's in standard deviations of the prior.",
    ("r", F8, ("responses", "responses"), "the flight's square-root information, prior included, right-hand side last"),
    ("root", F8, ("servo", "servo"), "of the estimate's covariance"),
    ("mean", F8, ("servo",), "estimate: frequency, damping, delay"),
    ("about", F8, ("servo",), "that the filter is linearised about"),
    ("frequency", F8, (), "the same as natural frequency [rad/s]"),
    ("damping", F8, (), "as damping ratio"),
    ("delay", F8, (), "as delay [s]"),
    ("next_step", F8, (), "time step that comes next [s]"),
    ("response", F8, ("responses", sx.N_STATES, sx.N_STATES), "of a step, and its derivatives"))

TIME = struct(
    "Time", "Where the filter is.",
    ("last", F8, (), "stamp of the last sample [s]"),
    ("running", F8, (), "1: there was one in this segment"),
    ("first", F8, (), "stamp of the first of all [s]"))

STEP = struct(
    "Step", "Constants of one time step.",
    ("h", F8, (), "its length [s]"),
    ("phi", F8, (2, 2), "transition of the nozzle: beta, beta_dot"),
    ("by_command", F8, (2,), "effect of the command on it"),
    ("once", F8, (3,), "integral of beta over the step, damped as the rate is, by beta, beta_dot, command"),
    ("twice", F8, (3,), "double integral"),
    ("keep", F8, (), "what is left of the turbulence"),
    ("fade", F8, (), "what known damping leaves of a rate"),
    ("reach", F8, (), "angle that a rate of 1 makes [s]"))

NOTE = struct(
    "Note", "How often the filter did something of its own accord.",
    ("outliers", I8, (), "measurements left out"),
    ("restarts", I8, (), "segments begun anew"),
    ("level_clamps", I8, (), "steps of a noise level cut short"),
    ("segments", I8, (), "begun"),
    ("withdrawn_changes", I8, (), "sudden changes that a contradiction of the model followed"))

MODES = struct(
    "Modes", "What is believed of slosh and bending; deviations in standard deviations of the prior.",
    ("now", F8, ("modes", N_NOW), "numbers as believed, and the nominal's"),
    ("own", F8, ("modes", N_OWN), "constants of a time step"),
    ("slope", F8, ("numbers", N_OWN), "their derivatives for each number, over a sample period"),
    ("sloped", F8, ("numbers",), "frequency at which they were taken [rad/s]"),
    ("next_step", F8, (), "the next time step [s]"),
    ("is_set", I8, (), "1: the numbers have not moved since the constants were set"),
    ("mean", F8, ("rigid_numbers",), "a6 and k1 beside the modes, relative; deviations of the numbers"),
    ("covariance", F8, ("rigid_numbers", "rigid_numbers"), "of these"),
    ("about", F8, ("numbers",), "that the filter is linearised about"))

FILTER_STATE = struct(
    "Filter", "State of the predictor.",
    ("x", F8, ("states",), "predicted state"),
    ("p", F8, ("states", "states"), "its covariance"),
    ("s", F8, ("states", "sensitivities"), "sensitivities: offset at the block's start, terms, servo, tests"),
    ("p_bar", F8, (2,), "relative deviations of a6, k1 it is linearised about"),
    ("level", F8, ("levels",), "log of noise standard deviations over the declared ones"),
    ("sx", F8, ("acting", "levels"), "derivative of x for the levels, but of bending"),
    ("sp", F8, ("levels", "acting", "acting"), "derivative of p for the levels, but of bending"),
    ("command", F8, (sx.MAX_DELAY_SAMPLES,), "past commands, newest first"),
    ("shaped", F8, (N_COMMAND_PATH,), "states of play, lag and wash-out [rad]"),
    ("time", TIME),
    ("gamma", F8, (), "flight-path angle at the last stamp [rad]"),
    ("step", STEP, (), "the last"),
    ("missed", STEP, (), "its last part, in which a command acts that no sample holds"),
    ("jump", F8, (), "mean square of the command's changes from sample to sample"),
    ("outliers", I8, (sx.N_CHANNELS,), "measurements in a row that each channel's gate refused"),
    ("note", NOTE),
    ("servo", UNKNOWN_SERVO),
    ("modes", MODES))

FILTER_WORK = struct(
    "FilterWork", "Scratch of the predictor.",
    ("transition", F8, ("states", "states"), "about the parameters believed"),
    ("steady", F8, ("states", "states"), "about the nominal's, for the gains"),
    ("matrix", F8, ("states", "states"), "of a product"),
    ("known", F8, (N_SLOPES,), "slopes of the known acceleration for theta, theta_dot, beta"),
    ("limited", F8, (4,), "what a limit of the servo's rate takes over a step: theta, theta_dot by k1, beta, beta_dot"),
    ("unlimited", F8, (4,), "the nozzle without it"),
    ("push", F8, ("nuisances",), "acceleration that a unit of each nuisance is"),
    ("column", F8, ("states",), "covariance that a channel shows"),
    ("gain", F8, ("states",), "of a measurement"),
    ("shown", F8, ("states",), "covariance's derivative that a channel shows"),
    ("slope", F8, ("states",), "derivative of the gain"),
    ("taylor", F8, (4, 5, 5), "matrices of the servo's exponential"),
    ("late", STEP, (), "what is left of a step as the command changes"),
    ("other", STEP, (), "a step of another servo"),
    ("moved", F8, ("responses", sx.N_STATES), "its response"),
    ("servo_drive", F8, ("servo", sx.N_STATES), "effect of the servo's deviations on the state over a step"),
    ("number_drive", F8, ("numbers", "states"), "effect of the modes' numbers on the state over a step"),
    ("mode_push", F8, (2, "sensitivities"), "what slosh adds to theta, theta_dot in each column of a product"),
    ("slosh", F8, (2,), "and in the state"),
    ("held", F8, ("states",), "effect of a command held over a step"),
    ("own", F8, (N_OWN,), "constants of a mode"),
    ("seen", F8, ("levels",), "derivatives of what a channel shows"),
    ("raw", F8, (N_VARIABLES, 1), "theta, theta_dot, beta at the step's middle; no tau: 0"),
    ("value", F8, (1,), "of a term there"),
    ("drive", F8, (2, "terms"), "effect of each term on theta, theta_dot over a step"),
    ("out", F8, ("sensitivities",), "sensitivities of the last innovation"),
    ("de", F8, ("levels",), "its derivative for the noise levels"),
    ("dv", F8, ("levels",), "relative derivative of its variance for them"))

MOMENTS = struct(
    "Moments", "What is believed of the relative deviations of a6 and k1.",
    *((name, F8, (), about) for name, about in sx.MOMENTS.items()))

BLOCK_COUNTS = struct(
    "BlockCounts", "How much was gathered.",
    ("rows", I8, (), "in the block"),
    ("samples", I8, (), "in the window"),
    ("gaps", I8, (), "in the window"))

DEVIATION = struct(
    "Deviation", "Of the relative deviations of a6 and k1 in a window; NaN where inactive.",
    ("a6", F8, (), "standard deviation"),
    ("k1", F8, (), "standard deviation"),
    ("correlation", F8, (), "of both"))

ACCUMULATOR = struct(
    "Accumulator", "Square-root information, right-hand side last.",
    ("window", F8, ("columns", "columns"), "of the current window: offset at its start, terms, servo"),
    ("psi", F8, ("states", "states"), "transition of an offset from the window's start to the block's"),
    ("s_start", F8, ("states", 2), "sensitivities for theta and beta at the block's start"),
    ("counts", BLOCK_COUNTS),
    ("start", F8, (), "first stamp of the block [s]"),
    ("score", F8, ("levels",), "of the noise levels over the block"),
    ("information", F8, ("levels", "levels"), "of the noise levels over the block"),
    ("level_information", F8, ("levels", "levels"), "over the flight, prior included"))

ACCUMULATOR_WORK = struct(
    "AccumulatorWork", "Scratch of a block and of a window's close.",
    ("triangle", F8, ("columns", "columns"), "of the current block: offset at its start, terms, servo"),
    ("pair", F8, ("pair", "pair"), "of the block: offset, theta, beta, right-hand side"),
    ("block", F8, (3, 3), "of the block, the state known: theta, beta, right-hand side"),
    ("root", F8, ("numbers", "numbers"), "of the covariance of the modes' numbers"),
    ("number_column", F8, ("rigid_numbers",), "covariance that a measurement of them shows"),
    ("sizes", F8, ("modes",), "mean square of each mode's size before the block"),
    ("column", F8, ("states",), "of a product with a transition"),
    ("scratch", F8, ((2, "columns", "columns"),), "rows on their way into a triangle"),
    ("square", F8, (("levels", "levels"),), "information of the noise levels"),
    ("order", I8, ("levels",), "of its pivots"),
    ("tau", F8, ("levels",), "its Householder factors"),
    ("right", F8, ("levels",), "its right-hand side"),
    ("step", F8, ("levels",), "of Fisher's scoring"),
    ("before", MOMENTS, (), "the tracked belief before the block"),
    ("belief", MOMENTS, (), "to restart the tracker with"),
    ("columns", I8, ("columns",), "that a solve keeps"),
    ("coefficient", F8, ("terms",), "of the window"),
    ("deviation", DEVIATION))

BANK = struct(
    "Bank", "State of the tracker; a member's state is (a6, k1, slope of a6, slope of k1), relative.",
    ("mean", F8, (len(MEMBERS), 4), "by member"),
    ("covariance", F8, (len(MEMBERS), 4, 4), "by member"),
    ("evidence", F8, (len(MEMBERS),), "forgotten sum of log predictive densities"),
    ("total", MOMENTS, (), "of the mixture"),
    ("weight", F8, (len(MEMBERS),), "of each member"))

BANK_WORK = struct(
    "BankWork", "Scratch of the tracker.",
    ("density", F8, (len(MEMBERS),), "log predictive densities of the last block"),
    ("row", F8, (4,), "of a measurement"),
    ("column", F8, (4,), "covariance that it shows"))

ONSETS = struct(
    "Onsets", "Counts of the detector.",
    ("next", I8, (), "slot of the next onset"),
    ("kept", I8, (), "onsets that are followed"),
    ("events", I8, (), "alarms so far"),
    ("since", I8, (), "blocks since the last event's onset"))

EVENTS = struct(
    "Events", "Alarms of sudden changes, the newest over the oldest; before and after are relative to the nominal.",
    ("time", F8, (ch.MAX_EVENTS,), "of the onset [s]"),
    ("time_std", F8, (ch.MAX_EVENTS,), "its standard deviation [s]"),
    ("kind", F8, (ch.MAX_EVENTS,), "K1_JUMP or BOTH_JUMP"),
    ("a6_before", F8, (ch.MAX_EVENTS,), "deviation"),
    ("a6_after", F8, (ch.MAX_EVENTS,), "deviation"),
    ("a6_variance", F8, (ch.MAX_EVENTS,), "of the jump of a6"),
    ("k1_before", F8, (ch.MAX_EVENTS,), "deviation"),
    ("k1_after", F8, (ch.MAX_EVENTS,), "deviation"),
    ("k1_variance", F8, (ch.MAX_EVENTS,), "of the jump of k1"),
    ("alarm", F8, (ch.MAX_EVENTS,), "when it was raised [s]"),
    ("stage", F8, (ch.MAX_EVENTS,), "OPEN, FINAL or WITHDRAWN"))

BEFORE = struct(
    "Before", "The tracked belief before each onset.",
    *((name, F8, (sx.CHANGE_BLOCKS,), about) for name, about in sx.MOMENTS.items()))

WATCH = struct(
    "Watch", "State of the detector of sudden changes.",
    ("mean", F8, (sx.CHANGE_BLOCKS, 2, 2), "deviations by onset, kind, parameter"),
    ("covariance", F8, (2 * sx.CHANGE_BLOCKS, 2, 2), "of these, by onset and kind"),
    ("factor", F8, (sx.CHANGE_BLOCKS, 2), "log Bayes factors"),
    ("before", BEFORE),
    ("start", F8, (sx.CHANGE_BLOCKS,), "of each [s]"),
    ("carried", F8, (sx.CHANGE_BLOCKS, "states", 2), "sensitivities at each onset, carried to the block's start"),
    ("counts", ONSETS),
    ("event", EVENTS),
    ("reference", MOMENTS, (), "belief before the last change"))

GUST_STATE = struct(
    "Gust", "State of the hypothesis that wind begins anew.",
    ("mean", F8, ("gust",), "error of the filter's state at the block's start, deviations of a6 and k1"),
    ("covariance", F8, ("gust", "gust"), "of these"),
    ("probability", F8, (), "of the hypothesis"))

CHECK = struct(
    "Check", "State of the test whether the model is true.",
    ("innovation", F8, (sx.N_CHANNELS,), "sums of the block at hand: normalised innovations"),
    ("for_a6", F8, (sx.N_CHANNELS,), "their sensitivities for a6"),
    ("for_k1", F8, (sx.N_CHANNELS,), "and for k1"),
    ("seen", I8, (sx.N_CHANNELS,), "measurements in it"),
    ("servo", F8, (sx.N_CHANNELS, "servo"), "sums of their sensitivities for the servo"),
    ("numbers", F8, (sx.N_CHANNELS, "numbers"), "and for the modes' numbers"),
    ("pending", F8, (sx.CHANGE_BLOCKS, sx.N_CHANNELS), "blocks that wait"),
    ("history", F8, (wh.WHITENESS_LAGS, sx.N_CHANNELS), "the last ones taken, newest first"),
    ("sums", F8, (sx.N_CHANNELS, wh.WHITENESS_LAGS + 1), "fading sums of a channel and of its products by lag"),
    ("statistic", F8, (), "of whiteness"),
    ("sum_weight", F8, (), "sum of squared fading weights, the variance of each sum"),
    ("last_change", F8, (), "alarm of the last sudden change [s]"),
    ("restless", F8, (), "alarm of one soon after another [s]"),
    ("losses", F8, (), "fading count of restarts because the filter had lost the sensors"),
    ("last_loss", F8, (), "the last of them [s]"),
    ("last_failed", F8, (), "when a window's test failed last [s]"),
    ("oldest", I8, (), "place of the oldest block that waits"),
    ("waiting", I8, (), "how many wait"),
    ("raised", I8, (), "1: the model is contradicted"),
    ("in_window", I8, (), "1: or was so in the window"),
    ("by_window", I8, (), "what the window's test said: PASSED, FAILED, FAILED_BEYOND_CHANCE"),
    ("changed", I8, (), "1: there was a sudden change"),
    ("is_restless", I8, (), "1: and another one soon after"),
    ("has_failed", I8, (), "1: a window's test has failed before"),
    ("beyond_chance", I8, (), "1: contradicted beyond chance"))

UNDECLARED = struct(
    "Undeclared", "State of the filters of wind and misalignment that nobody declared.",
    ("mean", F8, (un.FILTERS, "undeclared"), "a6, k1, their slopes, wind, lean"),
    ("covariance", F8, (un.FILTERS, "undeclared", "undeclared"), "of these"),
    ("past", F8, (2, "undeclared"), "the first filter's mean, ONSETS blocks apart, the newer at most ONSETS old"),
    ("past_covariance", F8, (2, "undeclared", "undeclared"), "of these"),
    ("better", F8, (un.FILTERS,), "nats by which each has predicted better since it last was no better"),
    ("noise", F8, (), "highest log noise level of a sensor when what is known was begun"),
    ("lasted", F8, (), "time since beyond THERE [s]"),
    ("found", I8, (), "1: they are there"),
    ("doubt", I8, (), "what else contradicts the model"),
    ("newer", I8, (), "the newer of what is remembered"),
    ("age", I8, (), "blocks taken since"))

UNDECLARED_WORK = struct(
    "UndeclaredWork", "Its scratch.",
    ("rows", F8, (un.N_BLOCK_COLUMNS, "columns"), "the block's triangle, column by column"),
    ("triangle", F8, (un.N_BLOCK_COLUMNS, un.N_BLOCK_COLUMNS), "of a6, k1, acceleration, right-hand side"),
    ("row", F8, (un.UNDECLARED_SIZE,), "of a measurement"),
    ("column", F8, (un.UNDECLARED_SIZE,), "covariance that it shows"))

GAUGE = struct(
    "Gauge", "State of the uncertainty level; rows and pairs are (a6, k1).",
    ("delta", F8, (2,), "place in the range"),
    ("delta_std", F8, (2,), "its standard deviation"),
    ("probability", F8, (2, OUT + 1), "of BANDS"),
    ("since", F8, (2,), "s, when delta's mean left the range; NaN if inside"),
    ("band", I8, (2,), "place in BANDS, or NO_BAND"),
    ("raised", I8, (2,), "1 while the sequential alarm is"),
    ("known_inside", I8, (2,), "1 once it was"),
    ("events", I8, (), "sudden changes seen"))

TRACKED = struct(
    "Tracked", "The tracked estimate; NaN where it is not valid.",
    ("a6", F8, (), "1/s^2"),
    ("k1", F8, (), "1/s^2"),
    ("a6_std", F8, (), "standard deviation"),
    ("k1_std", F8, (), "standard deviation"),
    ("correlation", F8, (), "of both"))

CHANGE_ROWS = struct(
    "ChangeRows", "Sudden changes, oldest first.",
    ("time", F8, (2 * ch.MAX_EVENTS,), "when it began [s]"),
    ("time_std", F8, (2 * ch.MAX_EVENTS,), "its standard deviation [s]"),
    ("before", F8, (2 * ch.MAX_EVENTS,), "1/s^2"),
    ("after", F8, (2 * ch.MAX_EVENTS,), "1/s^2"),
    ("size", F8, (2 * ch.MAX_EVENTS,), "1/s^2"),
    ("size_std", F8, (2 * ch.MAX_EVENTS,), "its standard deviation [1/s^2]"),
    ("alarm", F8, (2 * ch.MAX_EVENTS,), "when it was raised [s]"),
    ("parameter", I8, (2 * ch.MAX_EVENTS,), "A6 or K1"),
    ("final", I8, (2 * ch.MAX_EVENTS,), "1: its size is settled"))

REPORT = struct(
    "Report", "What leaves beside the outcome, as of now.",
    ("is_tracked", I8, (), "1: what is tracked is valid"),
    ("tracked", TRACKED),
    ("has_level", I8, (), "1: what is said of the range is valid"),
    ("delta", F8, (2,), "place of a6 and of k1 in the range"),
    ("delta_std", F8, (2,), "its standard deviation"),
    ("out_since", F8, (2,), "when it left the range [s]"),
    ("probability", F8, (2, OUT + 1), "of BANDS"),
    ("band", I8, (2,), "place in BANDS, or NO_BAND"),
    ("raised", I8, (2,), "1 while the out-of-range alarm is"),
    ("changes", I8, (), "how many rows of `change` there are"),
    ("change", CHANGE_ROWS),
    ("noise", F8, ("levels",), "noise levels over the declared ones"),
    ("air", F8, (2,), "wind angle and its standard deviation [rad], NaN without"),
    ("offset", F8, (N_OFFSETS, 2), "of model.OFFSETS: value and standard deviation, NaN where it is known"),
    ("actuator", F8, (N_SERVO, 2), "of model.SERVO: value and standard deviation, NaN where nothing of it is unknown"),
    ("actuator_corr", F8, (N_SERVO,), "correlations: of the first with the second and the third, of these two"),
    ("mode", F8, ("modes", 4), "frequency [rad/s], its standard deviation, coupling or gain, its standard deviation"))

OPTION = struct(
    "Option", "What is chosen of the filtered formulation.",
    ("estimate_levels", I8, (), "1: follow the noise levels"),
    ("least_samples", I8, (), "below which a window is SHORT"))

FILTERED_FIXED = struct(
    "Fixed", "Never changes in flight.",
    ("limits", LIMITS),
    ("belief", BELIEF),
    ("option", OPTION))

FILTERED_STATE = struct(
    "State", "What persists between samples.",
    *GATE,
    ("filter", FILTER_STATE),
    ("acc", ACCUMULATOR),
    ("bank", BANK),
    ("watch", WATCH),
    ("gust", GUST_STATE),
    ("check", CHECK),
    ("undeclared", UNDECLARED),
    ("active", I8, ("terms",), "1 for the terms believed to be there"),
    ("repeats", REPEATS),
    ("learned", F8, ("learned", "learned"), "of the terms, over many windows: square-root information"),
    ("gauge", GAUGE))

FILTERED_WORK = struct(
    "Work", "Meaningless between samples.",
    ("filter", FILTER_WORK),
    ("acc", ACCUMULATOR_WORK),
    ("bank", BANK_WORK),
    ("gust", F8, ("gust",), "of its covariance"),
    ("undeclared", UNDECLARED_WORK),
    ("held", I8, ("terms",), "terms that were active before"),
    ("sparse", SPARSE_WORK),
    ("report", REPORT))

REGRESSION = struct("Regression", "An estimator that regresses on the rows of a window.",
                    (FIXED, REGRESSION_FIXED), (STATE, REGRESSION_STATE), (WORK, REGRESSION_WORK))
FILTERED = struct("Filtered", "An estimator of the filtered formulation.",
                  (FIXED, FILTERED_FIXED), (STATE, FILTERED_STATE), (WORK, FILTERED_WORK))

# what stands apart: (name, part, type, shape, meaning), in the order of `update`'s arguments; extents beside those of
# `Size`: held (a window's rows and the one that may come after it), window, kept (rows), innovations (of a block),
# nodes (of the profile), air_nodes (of forecast and drift), mode_nodes, known_nodes, channels_shown, range_nodes
# (of the range sigma)
GATE_APART = (
    ("ring", STATE, F8, ("held", rb.N_COLUMNS), "the newest samples"),
    ("seals", STATE, I8, ("held",), "of its rows"))
SEPARATE_ARRAYS: dict[str, tuple[tuple[str, str, "np.dtype[Any]", tuple[Extent, ...], str], ...]] = {
    "Regression": (
        *GATE_APART,
        ("rows", WORK, F8, (N_SERIES, "window"), "a window's close, as `regression.rows` names them"),
        ("marks", WORK, I8, (N_MARKS, "window"), "of its rows, as `regression.rows` names them"),
        ("columns", WORK, F8, (("wider", "kept"),),
         "one after the other: the library's, later its factor; what the equations explain; drifts"),
        ("series", WORK, F8, (("wider", "kept"),), "residual with the drifts and without; influences on each term")),
    "Filtered": (
        *GATE_APART,
        ("rows", STATE, F8, ("columns", "innovations"), "whitened innovations of a block, column by column"),
        ("profile", FIXED, F8, ("nodes", sx.N_NODE), "t [s], a6, k1 [1/s^2]"),
        ("air", FIXED, F8, ("air_nodes", sx.N_AIR), "t [s], forecast wind [rad], drift [1/s]"),
        ("modes", FIXED, F8, ("mode_nodes", "mode_columns"), "t [s]; of each mode frequency, size, damping ratio"),
        ("known", FIXED, F8, ("known_nodes", N_KNOWN_NODE), "t [s], known acceleration [rad/s^2]"),
        ("shown", FIXED, F8, ("channels_shown", "states"), "what a channel shows besides its own state"),
        ("sigma", FIXED, F8, ("range_nodes", sx.N_NODE), "t [s], range of a6 and k1"))}
# of no elements where a model has none of it: an entry then gets None, and is compiled without what needs it
OPTIONAL = ("modes", "known", "shown")
CARRIED_FROM = {"Regression": "random", "Filtered": "filter"}  # this line of the state and all after it are sealed
