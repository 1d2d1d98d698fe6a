"""Measure what the extension gains: prediction errors over several horizons, on blocks that nothing was fitted to."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..likelihood.estimate import Fit, refreshed
from ..likelihood.likelihood import predict, run
from .model import Model
from .score import folds

HORIZON_SHARES = (0.1, 0.3, 1.0)  # of the longest horizon
GAIN_HORIZON = 1.0     # s
TURNS = 1.5            # of the vehicle's own time, over which a prediction says something of its numbers
SPACING = 0.1          # s between the starts of predictions
CHANNELS = ("theta", "theta_dot", "beta")


Fitted = tuple[Model, Fit]   # numbers, and the model with the noise levels that go with them


class Gain(NamedTuple):
    """Horizon [s] -> channel -> mean squares [unit^2]: errors of nominal, extended, full model; channel's change."""

    squares: dict[float, dict[str, tuple[float, float, float, float]]]
    nats: float
    source: str

    @property
    def longest(self) -> float:
        return max(self.squares)

    def nrmse(self, horizon: float) -> dict[str, tuple[float, float]]:
        """Return channel -> (nominal, extended): RMS prediction error over the RMS change, at this horizon [s]."""
        return {name: (math.sqrt(b / c), math.sqrt(a / c)) for name, (b, a, _, c) in self.squares[horizon].items()
                if c > 0.0}

    @property
    def share(self) -> float:
        """Share, 0 to 1, of removable squared error that the extension leaves; mean over horizons, attitude, rate."""
        left = [min(max((after - full) / (before - full), 0.0), 1.0) for before, after, full in self.of_motion()
                if before > full]
        return float(np.mean(left)) if left else 0.0
    def of_motion(self) -> list[tuple[float, float, float]]:
        """Return the mean squares before, after and of the full model, for each horizon of attitude and rate."""
        return [row[:3] for of in self.squares.values() for name, row in of.items() if name != "beta"]


def predictions(m: Model, fit: Fit, starts: np.ndarray, spans: np.ndarray, is_another: bool = False) -> np.ndarray:
    """Return errors ahead (starts, spans, 3), each start under numbers that its fold was not used for; is_another:
    under the fit's (another log)."""
    out = np.full((len(starts), len(spans), 3), np.nan)
    fold = m.log.fold_of(starts)
    for f, p in enumerate([fit.p] if is_another else folds(m, refreshed(m, fit))[1]):
        mine = np.arange(len(starts)) if is_another else np.flatnonzero(fold == f)
        out[mine] = predict(run(m.parameters(p)), starts[mine], spans)[0]
    return out


def held_out(fitted: Sequence[Fitted], nats: float, is_another: bool = False) -> Gain:
    """Return the gain of the final model over the nominal on blocks left out, or on a log that nothing was fitted to if
    `is_another`; fitted: nominal, final and full model."""
    m = fitted[0][0]
    row = m.log.period
    stiffness = float(np.max(np.abs(m.log.a6))) + abs(m.log.terms.get("sin(theta)", 0.0))
    longest = min(GAIN_HORIZON, TURNS / math.sqrt(max(stiffness, 1e-6)))
    spans = np.unique([max(1, round(h * longest / row)) for h in HORIZON_SHARES])
    starts = np.arange(max(10, m.log.n // 200), m.log.n - 1, max(1, round(SPACING / row)))
    errors = [predictions(*each, starts, spans, is_another) for each in fitted]
    squares: dict[float, dict[str, tuple[float, float, float, float]]] = {}
    for q, span in enumerate(spans):
        ends = np.minimum(starts + span, m.log.n - 1)
        of: dict[str, tuple[float, float, float, float]] = {}
        for ch, name in enumerate(CHANNELS):
            change = m.log.z[ends, ch] - m.log.z[starts, ch]
            good = np.isfinite(change) & np.all([np.isfinite(e[:, q, ch]) for e in errors], axis=0)
            if m.log.has[name] and good.sum() > 20:
                before, after, full_ = (trimmed(e[good, q, ch]) for e in errors)
                of[name] = (before, after, full_, float(np.mean(change[good]**2)))
        squares[round(float(span * row), 6)] = of
    return Gain(squares, nats, "a second log" if is_another else "blocks left out")


def trimmed(x: np.ndarray) -> float:
    """Return the mean square of x without its largest twentieth."""
    x = np.sort(x * x)
    return float(np.mean(x[:max(1, int(0.95 * len(x)))]))
