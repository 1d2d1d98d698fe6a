"""The alternatives of the equation of motion: causes of the catalogue, and shapes that it does not list.

Each alternative is a column, or some, beside the nominal's terms, or something on the input's way.  To add one: an
entry here, and a case with a known truth in the tests.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from launchid.weakform.rows import column
from sim.effects import CATALOGUE

from .score import Rows
from .signals import Signals, Travel, lagged, mode

TIMES = tuple(np.geomspace(2.0e-3, 0.3, 24).tolist())     # s, of delays and lags that are tried
WASHES = (0.05, 0.1, 0.2, 0.4, 0.8, 1.5, 3.0)             # s
PLAYS = tuple(np.geomspace(0.03, 1.5, 10).tolist())       # of the input's rms
RATES = tuple(np.geomspace(0.08, 0.9, 9).tolist())        # of the input's fastest
PULSES = (1.0 / 30.0, 1.0 / 20.0, 1.0 / 13.0, 1.0 / 8.0)  # of the log
ONSETS = tuple(np.linspace(0.1, 0.9, 33).tolist())        # of the log
SLOSH, BENDING = (2.0, 12.0), (14.0, 70.0)                # rad/s, where the windows and rows resolve them
LIGHT = (0.02, 0.03)                                      # damping ratios of the two
HATS = 8               # straight parts of a slow wander
BEYOND = 40.0          # of the log: a delay longer than its fortieth leaves too few rows
FAR = 0.35             # rad: nearer sin(theta) is theta
TURNED = 8.0           # rad: of a body that turns on and on an angle is no state
STILL = 0.05           # of the rate's rms, below which a body stands
WASHED = 1.3           # times the input, which a part of it cannot exceed
QUANTILE = 0.99        # of the input's rate that counts as its fastest


@dataclass(frozen=True, eq=False)
class View:
    """A log as an alternative sees it: signals, rows, and the input that acts with what is already on its way.

    rate   (n,) [rad/s] averaged over half a short window;  left (k,) of the rows, what the model so far leaves
    """

    signals: Signals
    rows: Rows
    travel: Travel
    input: np.ndarray
    rate: np.ndarray
    left: np.ndarray

    def mean(self, x: np.ndarray, order: int = 0) -> np.ndarray:
        """(k,) rows of a column."""
        return self.rows.mean(x, order)

    @property
    def length(self) -> float:
        """[s] Length of the log."""
        return len(self.signals.theta) * self.signals.period

    @property
    def window(self) -> float:
        """[s] the shorter window."""
        return self.rows.steps[0] * self.signals.period

    @property
    def moves(self) -> bool:
        """Whether the input does."""
        return float(np.ptp(self.input)) > 0.0 and bool(np.any(self.signals.k1 != 0.0))

    @property
    def is_bounded(self) -> bool:
        return float(np.ptp(self.signals.theta)) < TURNED

    @property
    def still(self) -> float:
        """Rate [rad/s] below which the body stands."""
        return max(STILL * float(np.std(self.rate)), 1e-12)

    @property
    def effect(self) -> np.ndarray:
        """(n,) [rad/s^2] Acceleration by the input."""
        return self.signals.k1 * self.input

    def has(self, *terms: str) -> bool:
        """Whether the nominal has one of these terms."""
        own = [term for term, _ in self.signals.record.nominal.terms]
        own += ["theta"] * bool(np.any(self.signals.a6 != 0.0)) + ["beta"] * bool(np.any(self.signals.k1 != 0.0))
        return any(term in own for term in terms)


Columns = Callable[[View, float], np.ndarray]


def one(view: View) -> Iterable[float]:
    """No number of its own."""
    return (0.0,)


def always(view: View) -> bool:
    return True


def moving(view: View) -> bool:
    return view.moves


def bounded(view: View) -> bool:
    return view.is_bounded


@dataclass(frozen=True)
class Alternative:
    """A part that may be missing.

    name      of the catalogue's cause, as `Hypothesis.label` says it, or words
    columns   (k,) or (k, c) rows of it at its own number; None: it is on the input's way, as `travel`
    grid      of its own number, which is no coefficient;  between: what lies between two of them is tried, too
    low, high of its coefficient;  when  it can be there
    is_listed whether the catalogue has it
    """

    name: str
    columns: Columns | None
    grid: Callable[[View], Iterable[float]] = one
    when: Callable[[View], bool] = always
    low: float = -math.inf
    high: float = math.inf
    travel: str = ""
    between: bool = False

    @property
    def is_listed(self) -> bool:
        return self.name.partition("(")[0] in CATALOGUE


def times(view: View) -> Iterable[float]:
    """Delays [s] that rows show and the log is long enough for."""
    return [time for time in TIMES if 0.25 * view.signals.period <= time < view.length / BEYOND]


def washes(view: View) -> Iterable[float]:
    return [time for time in WASHES if 2.0 * view.signals.period < time < view.length / HATS]


def plays(view: View) -> Iterable[float]:
    return [share * float(np.std(view.input)) for share in PLAYS]


def rates(view: View) -> Iterable[float]:
    fastest = float(np.quantile(np.abs(np.diff(view.input)), QUANTILE)) / view.signals.period
    return [share * fastest for share in RATES]


def modes(low: float, high: float, count: int) -> Callable[[View], Iterable[float]]:
    """Frequencies [rad/s] of a mode that rows and windows resolve."""
    def grid(view: View) -> Iterable[float]:
        least, most = max(low, 10.0 * math.pi / view.length), min(high, 0.3 * math.pi / view.signals.period)
        return np.geomspace(least, most, count).tolist() if most > least else ()
    return grid


def lines(view: View) -> Iterable[float]:
    """Frequencies [rad/s] about the highest line of what is left."""
    count = len(view.rows.first[0])
    left, t = (view.left / view.rows.weight)[:count], view.rows.middle[:count]
    frequency = np.geomspace(6.0 * math.pi / view.length, 1.5 * math.pi / view.window, 300)
    power = np.abs(np.exp(-1j * np.outer(frequency, t)) @ left)
    best = int(np.argmax(power))
    return np.linspace(frequency[max(best - 1, 0)], frequency[min(best + 1, 299)], 9).tolist()


def onsets(view: View) -> Iterable[float]:
    return [share * view.length for share in ONSETS]


def pulses(view: View) -> Iterable[float]:
    """Number 2 i + 1 of ten thousand is begin, and its whole part the duration's place: one number for two."""
    return [place + begin / (2.0 * view.length) for place, share in enumerate(PULSES)
            for begin in np.arange(0.0, (1.0 - 0.5 * share) * view.length, 0.25 * share * view.length).tolist()]


def _after(view: View, time: float, x: np.ndarray) -> np.ndarray:
    return view.mean(x) * (view.rows.middle > time)


def _pulse(view: View, number: float) -> np.ndarray:
    place = int(number)
    begin, lasts = (number - place) * 2.0 * view.length, PULSES[place] * view.length
    phase = (view.signals.t - begin) / lasts
    return view.mean(view.signals.a6 * np.where((phase > 0.0) & (phase < 1.0), 1.0 - np.cos(2.0 * np.pi * phase), 0.0))


def _line(view: View, frequency: float) -> np.ndarray:
    phase = frequency * view.signals.t
    return np.column_stack([view.mean(np.sin(phase)), view.mean(np.cos(phase))])


def _sine(view: View, number: float) -> np.ndarray:
    return view.mean(np.sin(view.signals.attack) - view.signals.attack)


def _slosh(view: View, frequency: float) -> np.ndarray:
    signals = view.signals
    return view.mean(frequency**2 * mode(signals.theta, frequency, LIGHT[0], signals.period, (-1.0, 0.0)))


def _bending(view: View, frequency: float) -> np.ndarray:
    signals = view.signals
    return view.mean(mode(view.input, frequency, LIGHT[1], signals.period, (0.0, frequency**2)), signals.equation[1])


def wander(view: View) -> np.ndarray:
    """(k, HATS) rows of what is straight within HATS parts of the log, and 0 at its begin."""
    nodes = np.linspace(0.0, view.length, HATS + 1)
    return np.column_stack([view.mean(np.interp(view.signals.t, nodes, hat)) for hat in np.eye(HATS + 1)[1:]])


def _term(term: str) -> Columns:
    """Rows of a library term."""
    def columns(view: View, number: float) -> np.ndarray:
        signals = view.signals
        return view.mean(column(term, signals.attack, view.rate, view.input, signals.t))
    return columns


def _drift(view: View) -> np.ndarray:
    """(n,) [s] time from the log's middle."""
    return view.signals.t - 0.5 * view.length


def is_commanded(view: View) -> bool:
    """The command acts, and it moves."""
    return view.moves and view.signals.nozzle is None and view.signals.record.command_is_known


def is_measured(view: View) -> bool:
    """The measured nozzle acts, and it moves."""
    return view.moves and view.signals.nozzle is not None


TABLE = (
    Alternative("actuator_delay", None, times, is_commanded, travel="delay", between=True),
    Alternative("actuator_bandwidth", None, times, is_commanded, travel="lag", between=True),
    Alternative("actuator_backlash", None, plays, is_commanded, travel="play", between=True),
    Alternative("actuator_rate_limit", None, rates, is_commanded, travel="rate", between=True),
    Alternative("input_washout", lambda view, time: view.mean(view.signals.k1 * lagged(
        view.input, time, view.signals.period)), washes, moving, -WASHED, 0.0, between=True),
    Alternative("aero_damping", lambda view, _: view.mean(view.rate), high=0.0),
    Alternative("friction", lambda view, _: view.mean(np.tanh(view.rate / view.still)), high=0.0),
    Alternative("aero_cubic", lambda view, _: view.mean(view.signals.a6 * view.signals.attack**3),
                when=lambda view: view.has("theta") and view.is_bounded),
    Alternative("missing_term(sin(theta))", _sine,
                when=lambda view: view.has("theta") and float(np.max(np.abs(view.signals.theta))) > FAR),
    Alternative("missing_term(theta)", _term("theta"),
                when=lambda view: not view.has("theta", "sin(theta)") and view.is_bounded),
    Alternative("missing_term(beta^2)", lambda view, _: view.mean((view.input - view.input.mean()) ** 2), when=moving),
    Alternative("nozzle_inertia", lambda view, _: view.mean(view.input, 2), when=moving),
    Alternative("slosh", _slosh, modes(*SLOSH, 12), between=True),
    Alternative("bending", _bending, modes(*BENDING, 22), moving, between=True),
    Alternative("gust", _pulse, pulses, lambda view: view.has("theta")),
    Alternative("control_loss", lambda view, time: _after(view, time, view.effect), onsets, moving),
    Alternative("moment_step", lambda view, time: _after(view, time, np.ones(len(view.effect))), onsets),
    Alternative("control_slope", lambda view, _: view.mean(view.effect * _drift(view)), when=moving),
    Alternative("periodic_disturbance", _line, lines),
    Alternative("the input leads", lambda view, _: view.mean(view.effect, 1), when=moving, low=0.0),
    Alternative("the square of the input with its sign", lambda view, _: view.mean(view.input * np.abs(view.input)),
                when=moving),
    Alternative("the measured nozzle is late", None, times, is_measured, travel="delay", between=True),
    Alternative("the measured nozzle lags", None, times, is_measured, travel="lag", between=True),
    Alternative("the body sticks", lambda view, _: view.mean((np.abs(view.rate) < view.still) * (
        view.signals.a6 * view.signals.attack + view.effect)), low=-WASHED, high=0.0),
    Alternative("damping by the square of the rate", lambda view, _: view.mean(view.rate * np.abs(view.rate)),
                high=0.0),
    Alternative("the square of the angle", _term("theta^2"), when=bounded),
    Alternative("angle times rate", _term("theta*theta_dot"), when=bounded),
    Alternative("a moment that wanders slowly", lambda view, _: wander(view)),
    Alternative("a6 drifts", lambda view, _: view.mean(view.signals.a6 * view.signals.attack * _drift(view)),
                when=lambda view: view.has("theta")),
    Alternative("a6 steps", lambda view, time: _after(view, time, view.signals.a6 * view.signals.attack), onsets,
                lambda view: view.has("theta")),
)
