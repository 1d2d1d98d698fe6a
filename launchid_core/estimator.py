"""The one class: samples in by `update`, estimates out by `estimate`."""

import math
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from . import checkpoint
from .config import Config
from .estimate import EMPTY, Change, Estimate, Level, Mode, Offset, Tracked, Uncertainty
from .filter.modes import BY_DAMPING
from .filter.states import A6
from .gate import ring as rb
from .model import MODE_KINDS, MODE_NUMBERS, OFFSETS, SERVO, Model
from .order.entries import calls_of, loop_of, table_of
from .order.memory import allocate
from .sample import NAN, Sample
from .status import EstimateStatus, Status
from .watch import uncertainty as un

_STATUSES = tuple(Status(code) for code in (*range(Status.RECOVERED + 1), *range(Status.BUSY, 0)))  # from the end: < 0
_ESTIMATE_STATUSES = {int(status): status for status in EstimateStatus}
_OK, _NUMERICS = EstimateStatus.OK, EstimateStatus.NUMERICS
_RECOVERED = rb.RECOVERED


class Estimator:
    """On-board identification of theta_ddot = a6 theta + k1 beta from samples, one at a time.

    Everything is validated, allocated and compiled in the constructor.  One
    estimator belongs to one thread; a second caller gets Status.BUSY.
    """

    def __init__(self, config: Config) -> None:
        self.config = config
        self._memory = allocate(config)
        self._parts = self._memory.parts
        self._calls = calls_of(config, self._memory)
        self._step = self._calls.update
        self._terms = config.terms
        self._busy = False
        self._calls.restart()

    def __getstate__(self) -> dict[str, object]:
        """The state for copy and pickle: configuration and persistent arrays; memory is allocated anew.  RuntimeError
        as `save`."""
        self._refuse_busy("copy")
        return {"config": self.config, "state": tuple(array.copy() for _, array in self._memory.state_arrays())}

    def __setstate__(self, saved: dict[str, Any]) -> None:
        self.__init__(saved["config"])  # type: ignore[misc]
        for (_, array), given in zip(self._memory.state_arrays(), saved["state"], strict=True):
            array[...] = given

    def reset(self) -> None:
        """Forget every sample and estimate and restart the row generator; configuration and memory stay.

        RuntimeError while an update runs.
        """
        self._refuse_busy("reset")
        self._calls.restart()

    def save(self) -> bytes:
        """Everything that persists between samples, to go on from with `restore`; a few tens of kilobytes.

        RuntimeError while an update runs (in another thread, or below a signal handler): the state is between two.
        """
        self._refuse_busy("save")
        return checkpoint.save(self.config, self._memory)

    def restore(self, saved: bytes) -> None:
        """Go on where `save` of an estimator with an equal configuration stood, to the same bits.

        ValueError says what is wrong with bytes that are damaged, not whole, of another configuration or another
        version; the estimator is then as before.  RuntimeError while an update runs.
        """
        self._refuse_busy("restore")
        checkpoint.restore(self.config, self._memory, saved)

    def _refuse_busy(self, call: str) -> None:
        if self._busy:
            raise RuntimeError(f"{call}: an update is running: one estimator belongs to one thread")

    def update(self, sample: Sample) -> Status:
        """Take one sample (seven floats in the order of `Sample`); never raises for any float.

        TypeError for what is no sample.
        """
        if self._busy:
            self._parts.state.counts.answers[0] += 1  # Status.BUSY is the first counter
            return Status.BUSY
        self._busy = True
        try:
            code = self._step(*sample)
        except TypeError:
            raise TypeError(_no_sample(sample)) from None
        finally:
            self._busy = False
        return _STATUSES[code] if code != _RECOVERED else self._begin_anew(sample)

    def replay(self, samples: np.ndarray | Iterable[Sample]) -> list[Estimate]:
        """Take samples (n, 7) in one call, as `update` would one by one; the estimate of every window that closed.

        For logs, not for flight: it waits until all are taken, and its loop is compiled when it is first called.
        RuntimeError while an update runs; ValueError for another shape.
        """
        self._refuse_busy("replay")
        table, take, at, estimates = table_of(samples), loop_of(self._memory), 0, []
        self._busy = True
        try:
            while at < len(table):
                at, code = take(table, at)
                if code == _RECOVERED:
                    self._begin_anew(Sample(*table[at - 1].tolist()))
                elif code == rb.WINDOW_COMPLETE:
                    estimate = self.estimate()
                    assert estimate is not None
                    estimates.append(estimate)
        finally:
            self._busy = False
        return estimates

    def _begin_anew(self, sample: Sample) -> Status:
        """Begin anew after damage to memory: forget all but the counters of answers, and take the sample as the first
        of all."""
        counted = self._parts.state.counts.answers
        before = counted.copy()
        self._calls.restart()
        self._step(*sample)
        counted[:] = before
        counted[Status.RECOVERED - Status.BUSY] += 1
        return Status.RECOVERED

    def _report(self) -> Any | None:
        """Tracked estimate, uncertainty level and sudden changes as of now (formulation `filtered`)."""
        if self._calls.report is None:
            return None
        self._calls.report()
        return self._parts.work.report

    def estimate(self) -> Estimate | None:
        """The estimate of the last window that closed; None before the first."""
        state, report = self._parts.state, self._report()
        if state.counts.estimates == 0:
            return None
        outcome = state.outcome
        status = _ESTIMATE_STATUSES.get(int(outcome.status), _NUMERICS)
        xi, support = outcome.xi.copy(), outcome.support.astype(bool)
        xi.setflags(write=False)
        support.setflags(write=False)
        t_start = float(state.clock.closed)
        model, more = self.config.model, dict[str, Any](offsets=MappingProxyType({}))
        if report is not None and model is not None:
            more = {"tracked": Tracked(bool(report.is_tracked), *_numbers(np.array(report.tracked))),
                    "uncertainty": _uncertainty(report) if self._memory.size.ranged else None,
                    **_air(report, model), **_actuator(report, model), "modes": _modes(report, model),
                    "modes_covariance": _modes_covariance(self._parts, model, t_start + self.config.window)}
        return Estimate(
            t_start, t_start + self.config.window, status == _OK, status, float(outcome.a6), float(outcome.k1),
            float(outcome.a6_std), float(outcome.k1_std), float(outcome.correlation), float(outcome.a6_dot),
            float(outcome.k1_dot), float(outcome.a6_bound), float(outcome.k1_bound), float(outcome.condition), xi,
            support, self._terms, int(outcome.used), int(outcome.gaps), whiteness=float(outcome.whiteness),
            absent=_named(self._terms, outcome.absent), terms_std=_named(self._terms, outcome.std), **more)

    def changes(self) -> tuple[Change, ...]:
        """Sudden changes found so far, oldest first (of the last MAX_EVENTS alarms; formulation `filtered`)."""
        report = self._report()
        if report is None:
            return ()
        of = report.change
        return tuple(Change(of.time.item(k), of.time_std.item(k), "a6" if of.parameter[k] == A6 else "k1",
                            of.before.item(k), of.after.item(k), of.size.item(k), of.size_std.item(k),
                            of.alarm.item(k), bool(of.final[k])) for k in range(int(report.changes)))

    @property
    def noise_levels(self) -> dict[str, float]:
        """Noise levels believed now as factors of the declared ones, by name; empty unless formulation `filtered`."""
        report, model = self._report(), self.config.model
        if report is None or model is None:
            return {}
        return dict(zip(model.levels, report.noise.tolist(), strict=True))

    @property
    def counts(self) -> dict[str, int]:
        """The number of times that `update` gave each status, by name: their sum is the number of calls.

        STUCK: windows with a sensor that stood still; WRAP: jumps of theta across +-pi that were undone.

        `filtered` adds what it did of its own accord: OUTLIER, measurements left out; RESTART, segments begun anew
        after a gap or because the filter had lost the sensors; LEVEL_CLAMP, steps of a noise level cut short;
        CHANGE_WITHDRAWN, sudden changes that a contradiction of the model followed.
        """
        state = self._parts.state
        counts = {status.name: int(state.counts.answers[status - Status.BUSY]) for status in Status}
        counts |= {"STUCK": int(state.counts.stuck), "WRAP": int(state.counts.wraps)}
        if self._calls.report is not None:
            note = state.filter.note
            counts |= {"OUTLIER": int(note.outliers), "RESTART": int(note.restarts),
                       "LEVEL_CLAMP": int(note.level_clamps), "CHANGE_WITHDRAWN": int(note.withdrawn_changes)}
        return counts

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays this estimator owns; constant after construction."""
        return self._memory.block.nbytes + sum(array.nbytes for array in self._memory.apart.values())


def _no_sample(given: object) -> str:
    """One line that says what `update` was given instead of a sample."""
    names = ", ".join(Sample._fields)
    count = f" of {len(given)}" if isinstance(given, tuple | list) else ""
    return f"update: expected a Sample, {len(Sample._fields)} floats ({names}); got {type(given).__name__}{count}"


def _named(terms: tuple[str, ...], values: np.ndarray) -> Mapping[str, float]:
    """The values that are numbers, by the name of their term."""
    return MappingProxyType({term: x for term, x in zip(terms, values.tolist(), strict=True) if x == x})  # noqa: PLR0124


def _numbers(values: np.ndarray) -> list[float]:
    """The values as Python's floats; each NaN is the one object NAN, so that equal answers compare equal."""
    return [NAN if math.isnan(x) else x for x in values.tolist()]


def _air(report: Any, model: Model) -> dict[str, Any]:
    """Wind and offsets out of a report, as fields of `Estimate`."""
    wind, wind_std = _numbers(report.air)
    offsets = {name: Offset(*_numbers(report.offset[k])) for k, name in enumerate(OFFSETS)
               if getattr(model, name) > 0.0}
    return {"wind": wind, "wind_std": wind_std, "offsets": MappingProxyType(offsets)}


def _actuator(report: Any, model: Model) -> dict[str, Any]:
    """The servo out of a report, as fields of `Estimate`; nothing of a servo that is known."""
    if not model.servo_sigma:
        return {}
    return {"actuator": MappingProxyType({name: Offset(*_numbers(report.actuator[k])) for k, name in enumerate(SERVO)}),
            "actuator_corr": tuple(_numbers(report.actuator_corr))}


def _modes(report: Any, model: Model) -> tuple[Mode, ...]:
    """Slosh and bending out of a report."""
    made, counts = [], dict.fromkeys(MODE_KINDS, 0)
    for mode, row in zip(model.modes, report.mode, strict=True):
        counts[mode.kind] += 1
        made.append(Mode(f"{mode.kind}{counts[mode.kind]}", *_numbers(row)))
    return tuple(made)


def _modes_covariance(parts: Any, model: Model, t: float) -> np.ndarray:
    """Covariance of a6, k1 and the modes' numbers at t [s], as `Estimate.modes_covariance`."""
    if not model.modes:
        return EMPTY
    belief, modes, count = parts.fixed.belief, parts.state.filter.modes, 2 + 2 * len(model.modes)
    covariance = np.zeros((count, count))
    if belief.size.numbers:
        given, kept = [0, 1], [0, 1]  # places in the filter's covariance, and in this one
        scale = [float(np.interp(t, model.profile_t, x)) for x in (model.profile_a6, model.profile_k1)]
        for j, (what, i) in enumerate(zip(belief.number.tolist(), belief.mode_of.tolist(), strict=True)):
            if what != BY_DAMPING:
                mode = model.modes[i]
                given.append(2 + j)
                kept.append(2 + 2 * i + what)
                scale.append(float(belief.number_sigma[j] * np.interp(t, mode.t, getattr(mode, MODE_NUMBERS[what]))))
        told = np.array(modes.covariance)[np.ix_(given, given)] * np.outer(scale, scale)
        covariance[np.ix_(kept, kept)] = told
        if parts.state.check.raised == 1:
            covariance[:] = math.nan
    covariance.setflags(write=False)
    return covariance


def _uncertainty(report: Any) -> Uncertainty:
    """The uncertainty level out of a report."""
    levels = []
    for p in range(2):
        delta, delta_std, since = _numbers(np.array((report.delta[p], report.delta_std[p], report.out_since[p])))
        band = int(report.band[p]) if report.has_level else un.NO_BAND
        levels.append(Level(delta, delta_std, un.BANDS[band] if 0 <= band < len(un.BANDS) else un.UNDECIDED,
                            tuple(_numbers(report.probability[p])), bool(report.raised[p] == 0), since))
    return Uncertainty(bool(report.has_level), *levels)
