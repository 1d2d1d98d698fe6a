"""By how much may the gains be changed?  The least and the largest factor on kp, and on kd, that keep what is required.

A factor is kept if, in every window that has margins, every required margin keeps its requirement with the whole of its
95 % interval (a window that is too uncertain to tell is left out, `telling`). While the factors are sought a window is
judged at those of its possible loops that are the worst ones for some margin with the gains as they are; at the end the
window that limits is judged anew with the gains of the limit, and the limit drawn back until that one keeps what is
required too.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from sim.sections import Required

from ..controller.law import Law
from .loops import loops
from .margin_spread import MARGINS, margin_spread, margin_table

if TYPE_CHECKING:
    from .flight_margins import Judged as JudgedMargins
    from .flight_margins import WindowMargins

FACTORS = np.geomspace(0.05, 20.0, 25)   # tried on a gain; beyond them nothing limits it
FINER = 12             # halvings of a limit's bracket: to 1e-4 of the factor
DRAWN_BACK = 8         # halvings of the bracket by whole intervals, where those do not keep what is required


def telling(windows: Sequence["WindowMargins"], required: Required) -> list["JudgedMargins"]:
    """Return the windows that tell which gains keep what is required: those that keep it with the whole of their
    intervals, and those whose estimate misses it.  The others are too uncertain to limit anything; if there are only
    such, all of them."""
    judged = [each.window for each in windows if each.window.spread is not None]
    told = [each for each in judged if each.spread is not None and (not each.spread.below(required) or any(
        margin.sign * getattr(each.spread, name).value < getattr(required, margin.required)
        for name, margin in MARGINS.items() if margin.required))]
    return told or judged


def allowed(judged: Sequence["JudgedMargins"], required: Required) -> dict[str, list[float | None]]:
    """Return gain -> [least, largest] factor on it that keeps what is required in every window (`telling`) with 95 %.

    None, None: no factor does;  the ends of FACTORS: nothing that was tried limits it;  {} if no window has margins
    """
    if not judged:
        return {}
    first = judged[0].controller
    assert first is not None
    return {name: _range(judged, name, required) for name in (("kp",) if first.law.is_of_rate else ("kp", "kd"))}


def _range(judged: Sequence["JudgedMargins"], name: str, required: Required) -> list[float | None]:
    """Return the least and the largest factor on a gain that every window bears, about 1 or next to it."""
    factors = np.sort(np.append(FACTORS, 1.0))
    kept = _kept_by(judged, name, factors, required)   # windows, factors
    good = np.flatnonzero(kept.all(axis=0))
    if len(good) == 0:
        return [None, None]
    middle = good[np.argmin(np.abs(np.log(factors[good])))]
    ends: list[float | None] = []
    for step in (-1, 1):
        k = middle
        while 0 <= k + step < len(factors) and kept[:, k + step].all():
            k += step
        if not 0 <= k + step < len(factors):
            ends.append(float(factors[k]))
            continue
        limiting = [each for each, bears in zip(judged, kept[:, k + step], strict=True) if not bears]
        ends.append(_limit(limiting, name, float(factors[k]), float(factors[k + step]), required))
    return ends


def _limit(judged: Sequence["JudgedMargins"], name: str, good: float, bad: float, required: Required) -> float:
    """Return the factor between one that windows bear and one that none of them does, up to which all bear it."""
    start = good
    for _ in range(FINER):
        half = math.sqrt(good * bad)
        bears = _kept_by(judged, name, np.array([half]), required)[:, 0]
        if bears.all():
            good = half
        else:
            bad, judged = half, [each for each, does in zip(judged, bears, strict=True) if not does]

    def misses(factor: float) -> bool:
        for each in judged:
            assert each.known is not None and each.controller is not None
            scaled = each.controller.scaled(**{name: factor})
            known = each.known if each.known.laws is None else replace(each.known, laws=scaled.laws)
            if margin_spread(known, scaled.law).below(required):
                return True
        return False

    if not misses(good):
        return good
    good, bad = start, good
    for _ in range(DRAWN_BACK):
        half = math.sqrt(good * bad)
        good, bad = (good, half) if misses(half) else (half, bad)
    return good


def _kept_by(judged: Sequence["JudgedMargins"], name: str, factors: np.ndarray, required: Required) -> np.ndarray:
    """Return whether each window (w,) keeps what is required with factors (n,) on a gain, with all of its worst loops
    (w, n).  Windows with one controller are judged together."""
    groups: dict[tuple[object, ...], list[int]] = {}
    for k, each in enumerate(judged):
        assert each.known is not None and each.controller is not None
        key = id(each.controller), each.known.count, each.known.is_first_order, each.known.modes
        groups.setdefault(key, []).append(k)
    kept = np.zeros((len(judged), len(factors)), bool)
    for group in groups.values():
        rows = [spread.worst for k in group if (spread := judged[k].spread) is not None]
        every = _keeps(judged[group[0]], np.concatenate(rows), {name: factors}, required)
        ends = np.cumsum([0, *map(len, rows)])
        for k, first, last in zip(group, ends[:-1], ends[1:], strict=True):
            kept[k] = every[:, first:last].all(axis=1)
    return kept


def kept_over(judged: "JudgedMargins", kp: np.ndarray, kd: np.ndarray, required: Required) -> np.ndarray:
    """Return for factors kp, kd (n,) on the gains of a window's controller 2 where what is required is kept with 95 %,
    1 where the estimate alone keeps it, 0 where it does not."""
    assert judged.spread is not None
    kept = _keeps(judged, judged.spread.worst, {"kp": kp, "kd": kd}, required)
    return np.where(kept.all(axis=1), 2.0, np.where(kept[:, 0], 1.0, 0.0))


def _keeps(judged: "JudgedMargins", worst: np.ndarray, factors: dict[str, np.ndarray],
           required: Required) -> np.ndarray:
    """Return for factors on gains, arrays (n,) by name, whether loops with the numbers `worst` (w, k) of a window's
    kind keep what is required (n, w)."""
    known, controller = judged.known, judged.controller
    assert known is not None and controller is not None
    count, parts = len(worst), []
    for each in zip(*(x.tolist() for x in factors.values()), strict=True):
        scaled = controller.scaled(**dict(zip(factors, each, strict=True)))
        law = scaled.law if known.laws is None else scaled.laws(worst[:, known.count:])
        parts.append([np.broadcast_to(x, (count, x.shape[-1])) for x in (law.theta, law.rate, law.lag)])
    theta, rate, lag = (np.concatenate(x) for x in zip(*parts, strict=True))
    law = Law(theta, rate, lag, controller.law.period).times(known.gain)
    plants = known.plants(np.tile(worst[:, :known.count], (len(parts), 1)))
    table = margin_table(loops(plants, law))
    kept = np.any(table, axis=1)
    for k, margin in enumerate(MARGINS.values()):
        if margin.required:
            kept = kept & (margin.sign * table[:, k] >= getattr(required, margin.required))
    return np.asarray(kept).reshape(len(parts), count)
