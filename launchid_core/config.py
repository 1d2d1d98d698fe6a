"""Everything a user chooses, validated once, before flight."""

import dataclasses
import math
import operator
from dataclasses import dataclass

from .algebra.library import LIBRARIES, library_terms
from .choices import FORMULATIONS, NOISE_LEVELS, SLOWEST, SOLVERS
from .filter.states import MAX_DELAY_SAMPLES
from .gate.ring import LAST_SAMPLE
from .model import Model

MAX_ROWS = 1_000_000  # of one window: 48 MB of ring, beyond any flight computer and any log read here
MIN_ROWS = 4
FASTEST_SERVO = 1.0e4  # of a step's matrix: squarings then cost 12 of the 16 digits of the slow part
SAME_PERIOD = 1.0e-3  # relative: a sample period so near the controller's is the controller's
T_LIMIT_MAX = 1.0e12  # s: stamps are counted in windows, in 64 bits


@dataclass(frozen=True, kw_only=True)
class Config:
    """Choices of an `Estimator`.  A wrong value raises ValueError naming field, value and allowed range.

    window            [s]  length of a window.  1 s: the paper's, for constant dynamics; 0.3 s for varying ones
    sample_period     [s]  expected time between samples; with `window` it fixes the rows m of a window
    compression            keep one of N rows at random, N >= 1.  1: every row carries information under noise
    seed                   of the row choice, 0 <= seed < 2^63.  Same seed, same rows on every machine
    library                name or tuple of terms (`launchid_core.LIBRARIES`).  rigid-body: theta and beta alone
    formulation            `measured` (needs theta_ddot), `difference`, `integral` or `filtered` (needs `model`).
                           integral: at the bound in 1 s windows of constant dynamics; where a6 and k1 vary, none
                           of the first three can be trusted under noise.  filtered reaches the Cramer-Rao bound
    model                  what the filtered formulation believes of the vehicle; None for the others
    beta_held              beta acts from each sample to the next, as a command that is held does; False: it moves
                           between them.  For `integral`, which then integrates its steps exactly
    noise                  `estimated`: the model's noise levels are a prior, followed in flight; `declared`: exact
    solver                 stls (the paper's), sr3, ssr or lasso
    threshold              coefficients below it are cut, in the raw units of each; None: a term goes that explains
                           less than 0.5 % of the acceleration (rms) by itself, whatever its unit (none inside `lpv`)
    max_gap           [s]  a longer step between samples starts a new segment; None: 1.5 sample periods
    theta_limit       [rad]      samples beyond any of these seven are rejected as RANGE, so that no absurd value can
    theta_dot_limit   [rad/s]    poison a window; the defaults are beyond any launcher and any test stand
    beta_limit        [rad]
    theta_ddot_limit  [rad/s^2]
    beta_cmd_limit    [rad]
    gamma_limit       [rad]
    t_limit           [s]        1e10: above it a float64 stamp is coarser than 2 microseconds
    theta_saturation, theta_dot_saturation, beta_saturation  [rad, rad/s, rad]  end stops of the sensors: samples
                           at or beyond are left out of the regression (SATURATED if too few remain); inf: none
    """

    window: float = 1.0
    sample_period: float = 0.01
    compression: int = 1
    seed: int = 0
    library: str | tuple[str, ...] = "rigid-body"
    formulation: str = "integral"
    model: Model | None = None
    beta_held: bool = False
    noise: str = "estimated"
    solver: str = "stls"
    threshold: float | None = None
    max_gap: float | None = None
    theta_limit: float = 100.0
    theta_dot_limit: float = 1000.0
    beta_limit: float = 1000.0
    theta_ddot_limit: float = 1.0e5
    beta_cmd_limit: float = 1000.0
    gamma_limit: float = 100.0
    t_limit: float = 1.0e10
    theta_saturation: float = math.inf
    theta_dot_saturation: float = math.inf
    beta_saturation: float = math.inf

    def __post_init__(self) -> None:
        self._require_real("sample_period", 1e-6, 1e4)
        self._require_real("window", MIN_ROWS * self.sample_period, MAX_ROWS * self.sample_period)
        self._require_integer("compression", 1, self.rows)
        self._require_integer("seed", 0, 2**63 - 1)
        self._require_name("formulation", FORMULATIONS)
        self._require_name("solver", SOLVERS)
        self._require_name("noise", NOISE_LEVELS)
        if not isinstance(self.beta_held, bool):
            raise ValueError(f"beta_held={self.beta_held!r}: expected True or False")
        if isinstance(self.library, list):
            object.__setattr__(self, "library", tuple(self.library))
        if not isinstance(self.library, str) and not (
                isinstance(self.library, tuple) and all(isinstance(term, str) for term in self.library)):
            raise ValueError(f"library={self.library!r}: expected a name ({', '.join(LIBRARIES)}) or a tuple of terms")
        terms = library_terms(self.library)
        if self.threshold is not None:
            self._require_real("threshold", 0.0, 1e12)
        if self.max_gap is None:
            object.__setattr__(self, "max_gap", LAST_SAMPLE * self.sample_period)
        self._require_real("max_gap", self.sample_period, 1e10)
        self._require_real("t_limit", 0.0, T_LIMIT_MAX, above=True)
        for field in dataclasses.fields(self):
            if field.name.endswith(("_limit", "_saturation")):
                self._require_real(field.name, 0.0, math.inf, above=True)
        if self.formulation == "filtered":
            self._require_filtered(terms)
        if self.kept_rows < len(terms) + 2:
            raise ValueError(
                f"compression={self.compression!r} keeps {self.kept_rows} of the {self.rows} rows of a window, too few "
                f"for the {len(terms)} terms of the library: allowed 1..{max(1, self.rows // (len(terms) + 2))} "
                "(or a longer window)")

    def _require_filtered(self, terms: tuple[str, ...]) -> None:
        """Refuse what the filtered formulation cannot use."""
        if not isinstance(self.model, Model):
            raise ValueError(f"model={self.model!r}: formulation 'filtered' expects a Model "
                             "(profile, actuator, noises)")
        if self.compression != 1:
            raise ValueError(f"compression={self.compression!r}: formulation 'filtered' uses every sample, expected 1")
        if "theta" not in terms or "beta" not in terms or any("tau" in term for term in terms):
            raise ValueError(f"library={self.library!r}: formulation 'filtered' expects theta, beta and "
                             "no term in tau")
        if self.sample_period > SLOWEST * self.model.noise_period:
            raise ValueError(
                f"sample_period={self.sample_period!r}: formulation 'filtered' expected at most {SLOWEST} of the "
                f"controller's periods of {self.model.noise_period:g} s: more commands would be missing")
        speed = self.model.natural_frequency * max(1.0, 2.0 * self.model.damping_ratio)
        if self.model.time_constant == 0.0 and speed * self.sample_period > FASTEST_SERVO:
            raise ValueError(f"model.natural_frequency={self.model.natural_frequency!r}: expected natural_frequency "
                             f"max(1, 2 damping_ratio) sample_period of at most {FASTEST_SERVO:g}; a servo that fast "
                             "is a first-order one with a time_constant")
        if self.model.delay > MAX_DELAY_SAMPLES * self.sample_period - 2 * self.sample_period:
            raise ValueError(f"model.delay={self.model.delay!r}: expected at most {MAX_DELAY_SAMPLES - 2} "
                             "sample periods")

    def _require_real(self, name: str, low: float, high: float, above: bool = False) -> None:
        """Convert to float and demand low <= value <= high (value > low if `above`)."""
        value = getattr(self, name)
        expected = f"a number {'above' if above else 'from'} {low:g} to {high:g}"
        try:
            number = math.nan if isinstance(value, (bool, str)) else float(value)
        except (TypeError, ValueError, OverflowError):
            number = math.nan
        if not (low <= number <= high) or (above and number == low):
            raise ValueError(f"{name}={value!r}: expected {expected}")
        object.__setattr__(self, name, number)

    def _require_integer(self, name: str, low: int, high: int) -> None:
        value = getattr(self, name)
        try:
            good = not isinstance(value, bool) and low <= operator.index(value) <= high
        except TypeError:
            good = False
        if not good:
            raise ValueError(f"{name}={value!r}: expected an integer from {low} to {high}")
        object.__setattr__(self, name, int(value))

    def _require_name(self, name: str, allowed: tuple[str, ...]) -> None:
        value = getattr(self, name)
        if value not in allowed:
            raise ValueError(f"{name}={value!r}: expected one of {', '.join(allowed)}")

    @property
    def rows(self) -> int:
        """Rows m of a full window."""
        return round(self.window / self.sample_period)

    @property
    def kept_rows(self) -> int:
        """Rows p kept of them."""
        return self.rows // self.compression

    @property
    def missing_commands(self) -> float:
        """Share of the time between two samples in which a command acts that no sample holds (`filtered`)."""
        period = self.sample_period if self.model is None else self.model.noise_period
        share = 1.0 - period / self.sample_period
        return share if share > SAME_PERIOD else 0.0

    @property
    def terms(self) -> tuple[str, ...]:
        """Canonical names of the library's terms, in the order of xi's rows."""
        return library_terms(self.library)
