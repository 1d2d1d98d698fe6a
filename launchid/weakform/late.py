"""Let beta act later than it is logged: after a delay, and behind first-order lags."""

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np

from ..formatting import json_number
from .modes import Modes, ends_of, in_modes, values_of
from .rows import Rows, before

SHIFT = 3.0         # standard deviations of a shift of beta that is there
LAGS_KEPT = 12.0    # lags, of the response that is computed
LAGS_FORGOTTEN = 3.0  # of a stretch's beginning, after which what was not logged acts no more


def later(rows: Rows, lead: float) -> np.ndarray:
    """Return beta (n,) delayed by `lead` [s]; of a held beta the mean over each step."""
    t = rows.t
    if not rows.is_held:
        return np.interp(t - lead, t, rows.beta)
    steps = np.append(np.diff(t), rows.period)
    edges = np.append(t, t[-1] + rows.period)
    whole = np.concatenate([[0.0], np.cumsum(rows.beta * steps)])
    moved = np.interp(edges - lead, edges, whole)
    at = edges - lead   # before the first row and behind the last its input is that of these
    moved += np.minimum(at - edges[0], 0.0) * rows.beta[0] + np.maximum(at - edges[-1], 0.0) * rows.beta[-1]
    return np.asarray(np.diff(moved) / steps)


def lagging(rows: Rows, lag: float) -> np.ndarray:
    """Return beta (n,) filtered by a first-order lag of time constant `lag` [s]; each stretch begins at rest."""
    acting = rows.beta.copy()
    for a, b in itertools.pairwise(rows.bounds.tolist()):
        grid, _ = grid_of(rows, a, b)
        beta = np.interp(grid, rows.t[a:b], rows.beta[a:b])
        ages = rows.period * np.arange(min(len(grid), math.ceil(LAGS_KEPT * lag / rows.period)) + 1)
        weight = -np.diff(np.exp(-ages / lag))
        x = beta - beta[0]
        response = np.convolve(0.5 * (x + before(x)), weight)[:len(grid)]
        acting[a:b] = beta[0] + np.interp(rows.t[a:b], grid, response)
    return acting


def held_acting(rows: Rows, lead: float, lag: float, order: int) -> np.ndarray:
    """Return the mean over each step of a held beta (n,) delayed by `lead` [s] and behind `order` equal first-order
    lags, `lag` [s] in all: what its steps answer is known between the rows too.  Each stretch begins at rest."""
    acting, period = rows.beta.copy(), rows.period
    ahead = max(0, math.ceil(-lead / period))
    for a, b in itertools.pairwise(rows.bounds.tolist()):
        grid, last = grid_of(rows, a, b)
        kept = min(len(grid), math.ceil((max(lead, 0.0) + LAGS_KEPT * lag) / period) + 1)
        answer = ramp_response(period * np.arange(-ahead - 1, kept + 2) - lead, lag, order)
        x = np.append(rows.beta[a:b][last], np.full(ahead, rows.beta[b - 1])) - rows.beta[a]
        mean = np.convolve(x, np.diff(answer, 2) / period)[ahead:ahead + len(grid)]
        whole = np.concatenate([[0.0], period * np.cumsum(mean)])
        edges = np.append(rows.t[a:b], rows.t[b - 1] + period)
        area = np.diff(np.interp(edges, np.append(grid, grid[-1] + period), whole))
        acting[a:b] = rows.beta[a] + area / np.diff(edges)
    return acting


def ramp_response(age: np.ndarray, lag: float, order: int) -> np.ndarray:
    """Return the integral (n,) [s] of the step response of `order` equal lags, `lag` [s] in all, at ages (n,) [s]."""
    x = np.maximum(age, 0.0)
    if not lag > 0.0:
        return x
    each = lag / order
    fading = np.exp(-x / each)
    return x - each * (1.0 - fading) if order == 1 else x - 2.0 * each * (1.0 - fading) + x * fading


def grid_of(rows: Rows, a: int, b: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (even times [s] over a stretch from row a to b - 1, the stretch's last row at or before each)."""
    grid = rows.t[a] + rows.period * np.arange(math.ceil((rows.t[b - 1] - rows.t[a]) / rows.period) + 2)
    return grid, np.searchsorted(rows.t[a:b], grid + 1e-6 * rows.period, side="right") - 1


def without_beginnings(rows: Rows, length: float) -> Rows:
    """Return the rows without the first `length` [s] of each stretch: there a delayed beta would come from before the
    stretch, where nothing is logged."""
    known = rows.t >= np.repeat(rows.t[rows.bounds[:-1]], np.diff(rows.bounds)) + length
    kept = np.add.reduceat(known, rows.bounds[:-1])
    arrays = {name: getattr(rows, name)[known] for name in ("t", "theta", "gamma", "theta_dot", "beta", "fast")}
    return replace(rows, **arrays, bounds=np.concatenate([[0], np.cumsum(kept[kept > 0])]))


def acting_later(rows: Rows, lead: float, lag: float, order: int = 1) -> Rows:
    """Return the rows with beta delayed by `lead` [s] and behind `order` equal first-order lags, `lag` [s] in all."""
    if rows.is_held:
        return replace(rows, beta=held_acting(rows, lead, lag, order)) if lead or lag > 0.0 else rows
    acting = rows
    for _ in range(order if lag > 0.0 else 0):
        acting = replace(acting, beta=lagging(acting, lag / order))
    return replace(acting, beta=later(acting, lead)) if lead else acting


def with_betas(rows: Rows, m: Modes, terms: tuple[str, ...], betas: list[np.ndarray]) -> np.ndarray:
    """Return the columns (n, k, q) of terms, those of regression m, with each of k betas (rows,) instead."""
    places = [k for k, term in enumerate(terms) if "beta" in term]
    moving = tuple(terms[k] for k in places)
    values = [np.column_stack([values_of(rows, term, rows.attack, rows.theta_dot, beta) for term in moving])
              for beta in betas]
    ends = [ends_of(rows, moving, each, beta) for each, beta in zip(values, betas, strict=True)]
    phi = in_modes(rows, np.hstack(values), np.hstack(ends), with_doubt=False)
    whole = np.repeat(m.phi[:, None, :], len(betas), axis=1)
    whole[:, :, places] = np.reshape(phi, (len(phi), len(betas), len(places)))
    return whole


@dataclass(frozen=True)
class Lead:
    """The time [s] by which beta leads its effect, acting later than it is logged, and its standard deviation.

    grows    [s/s] over the log where that is sure, by two clocks, else 0;  middle  [s] when the lead is `value`
    """

    value: float
    std: float
    grows: float = 0.0
    middle: float = 0.0

    def at(self, rows: Rows) -> float:
        """Return the lead [s] in the middle of `rows`."""
        return self.value + self.grows * (0.5 * float(rows.t[0] + rows.t[-1]) - self.middle)

    @property
    def json(self) -> dict[str, float | None]:
        """The lead as the `delay` of the identify JSON."""
        return {"value": self.value, "std": json_number(self.std)}

    @property
    def is_sure(self) -> bool:
        """Whether the lead is significant: |value| > SHIFT std."""
        return abs(self.value) > SHIFT * self.std


@dataclass(frozen=True)
class Late:
    """How beta acts later than it is logged: after a delay, and filtered by `order` equal first-order lags.

    lag   sum of their time constants [s], and its standard deviation; (0, 0): none
    trade [s/s]  by how much the most likely delay grows with the lag; the deviation of `lead` is that at one lag
    """

    lead: Lead
    lag: tuple[float, float] = (0.0, 0.0)
    order: int = 1
    trade: float = 0.0

    def acting(self, rows: Rows, lead_by: float = 0.0, lag_by: float = 0.0) -> Rows:
        """Return the rows with beta as it acts, `lead_by`, `lag_by` [s] later still, less beginnings of stretches."""
        late = acting_later(rows, self.lead.value + lead_by, self.lag[0] + lag_by, self.order)
        return without_beginnings(late, self.lead.value + LAGS_FORGOTTEN * self.lag[0])

    def doubts(self, rows: Rows) -> list[np.ndarray]:
        """Return betas (rows,) of `acting` with the delay, and with the lag and the delay that is most likely with it,
        larger by its standard deviation."""
        lead_by = self.lead.std if math.isfinite(self.lead.std) else 0.0
        return [self.acting(rows, *by).beta for by in ((lead_by, 0.0), (self.trade * self.lag[1], self.lag[1]))
                if any(by)]

    @property
    def json(self) -> dict[str, object]:
        """The delay and the lag as the `late` of the identify JSON."""
        lag = {"value": self.lag[0], "std": self.lag[1]} if self.lag[0] else None
        return {"delay": self.lead.json, "lag": lag, "order": self.order}
