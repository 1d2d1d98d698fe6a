"""Diagnose several flights of one vehicle in one fit: the numbers of the vehicle are common, each flight has its own
weather, offsets and start.

The flights stand one after another on one clock, with gaps over which the filter forgets all of the motion.  So the
likelihood is the sum of the flights', and one elimination asks left-out stretches of all of them.  What a flight may
have of its own within what the nominal declares ([offsets], [wind]) is a number of that flight, with the declared as
prior.

What happens once, as a loss, a gust or a mode's beginning, is a flight's own: it is sought in each flight alone
(`verdict.diagnose`).  Noise levels are common: the sensors are.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from sim.effects import values
from sim.nominal import Nominal

from ..likelihood.estimate import Table, fit_levels, gauss_newton
from ..log.log import Log
from ..log.record import CLOCKED
from .adapter import Reading, read
from .candidates import Column, Kind, Shape
from .decision import decided
from .elimination import Search
from .known import SCORE_BLOCKS, KnownLog
from .model import Model
from .named import Result
from .numbers import TOLERANCE_SIGMAS
from .start import all_of, best_delay, best_start
from .stranger import judged
from .track import Track

APART = 25             # rows between two flights: more than those after which the filter begins anew
OWN = {"misalignment": None, "wind": None, "gyro_bias": 1, "nozzle_bias": 2}   # number: the channel that it shifts


@dataclass(frozen=True, eq=False)
class SeveralLogs(KnownLog):
    """Flights one after another; `first` (k,) their first rows."""

    first: tuple[int, ...] = ()

    @cached_property
    def flight(self) -> np.ndarray:
        """The number (n,) of each row's flight."""
        return np.searchsorted(np.array(self.first), np.arange(self.n), side="right") - 1

    def of_each(self, made: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Return (n,) what a function makes of the times of each flight's rows."""
        return np.concatenate([made(self.t[:-1][self.flight == k]) for k in range(len(self.first))])

    @property
    def span(self) -> float:
        return max(float(np.ptp(self.t[:-1][self.flight == k])) for k in range(len(self.first)))

    @cached_property
    def about(self) -> np.ndarray:
        return self.of_each(lambda t: t - 0.5 * (t[0] + t[-1]))

    @cached_property
    def middle(self) -> np.ndarray:
        return self.about + 0.5 * self.period

    @cached_property
    def tau(self) -> np.ndarray:
        return self.of_each(lambda t: np.linspace(-1.0, 1.0, len(t)))

    @cached_property
    def block(self) -> np.ndarray:
        return self.rows * SCORE_BLOCKS // self.n


def joined(tracks: Sequence[Track]) -> SeveralLogs:
    """Return tracks of one period one after another."""
    one, at = tracks[0], tracks[0].t[0]
    t, ticks = [], []
    for each in tracks:
        shift = at - each.t[0]
        t.append(each.t[:-1] + shift)
        ticks.append(each.ticks[:-1] + shift)
        at = t[-1][-1] + APART * one.period
    end = float(t[-1][-1] + np.diff(tracks[-1].t)[-1])
    times = np.append(np.concatenate(t), end)
    at_ticks = np.append(np.concatenate(ticks), max(end, ticks[-1][-1] + 1e-9))
    edges = np.append((times[:-1, None] + np.diff(times)[:, None] * np.arange(one.sub) / one.sub).ravel(), end)
    z, commands, a6, k1, wind = (np.concatenate([getattr(each, name) for each in tracks])
                                 for name in ("z", "commands", "a6", "k1", "wind"))
    track = Track(one.record, times, np.ascontiguousarray(z), one.sub, edges, at_ticks, commands, a6, k1, wind)
    first = np.cumsum([0, *(len(each.z) for each in tracks[:-1])])
    return SeveralLogs(track, track.z, first=tuple(int(k) for k in first))


def with_own(m: Model) -> Model:
    """Return the model with what each flight may have of its own: offsets and weather that the nominal declares."""
    shapes, numbers = list[Shape](), list(m.table.numbers)
    assert isinstance(m.log, SeveralLogs)
    for name, channel in OWN.items():
        sigma = 0.0 if name not in m.table else float(m.table.tol[m.table.index(name)]) / TOLERANCE_SIGMAS
        if not sigma > 0.0 or (m.log.nominal.offsets is None and name != "wind"):
            continue
        for k in range(len(m.log.first)):
            kind = Kind(f"{name}@{k}", "", ("size",), 1, partial(_columns, name=name, k=k, channel=channel),
                        prior=partial(_prior, sigma=sigma))
            shape = Shape(kind, (f"{name}@{k}.size",))
            shapes.append(shape)
            numbers += kind.numbers(m, shape, ())
    return replace(m, table=Table.of(numbers), shapes=tuple(shapes))


def _prior(_: Model, sigma: float) -> float:
    return sigma


def _columns(m: Model, name: str, k: int, channel: int | None) -> list[Column]:
    """Return what a unit of a flight's own number does: a moment, or a shift of a channel."""
    assert isinstance(m.log, SeveralLogs)
    there = (m.log.flight == k).astype(float)
    if channel is None:
        return [Column(force=there * (m.log.k1 if name == "misalignment" else m.log.a6))]
    shift = np.zeros((m.log.n, 3))
    shift[:, channel] = there
    return [Column(shift=shift)]


def can_join(readings: Sequence[Reading], nominal: Nominal) -> str:
    """Return why flights cannot be diagnosed in one fit; "": they can."""
    for each in readings:
        if each.track is None:
            return f"{each.log.path}: nothing can be fitted to it"
        if each.controller is not None and each.controller.is_foreign:
            return f"{each.log.path}: its commands are another controller's"
    tracks = [each.track for each in readings if each.track is not None]
    of = {(round(each.period, 9), each.sub, each.record.input) for each in tracks}
    if len(of) > 1:
        return "the flights have other periods, or other inputs: log all alike"
    if any(name in CLOCKED for effect in nominal.effects for name in values(effect)):
        return "the nominal has an effect at a time of one flight"
    return ""


def diagnose_jointly(logs: Sequence[Log], nominal: Nominal, noise: str = "bounded",
                     say: Callable[[str], None] = lambda text: None) -> Result | str:
    """Diagnose flights of one vehicle together; one sentence instead if that cannot be done.

    Parameters
    ----------
    logs : sequence of Log
    nominal : Nominal
    noise : str
        As in `verdict.diagnose`.
    say : callable
        Told what is being done.
    """
    readings = [read(log, nominal) for log in logs]
    if why := can_join(readings, nominal):
        return why
    say("all flights: everything free")
    m = with_own(Model.of_log(joined([each.track for each in readings if each.track is not None]), noise))
    plain, start = best_start(m) if m.log.is_commanded and m.log.is_flown else (m, best_delay(m))
    fit = gauss_newton(m, start if len(plain.shapes) == len(m.shapes) else m.table.null, all_of(m), frozenset(), 3)
    for _ in range(2):
        m = fit_levels(m, fit.p)
        fit = gauss_newton(m, fit.p, fit.free, frozenset(), 3)
    say("all flights: taking away")
    own = frozenset(m.table.index(name) for shape in m.shapes for name in shape.names)
    if not m.log.is_flown:
        return judged(m, fit.p, readings[0], nominal, own)
    search = Search(m, own)
    search.groups = [group for group in search.groups if "@" not in group.name]
    el = search.run(fit.p)
    return decided(m, readings[0], nominal, replace(el, notes=()))
