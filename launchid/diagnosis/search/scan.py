"""First look at every hypothesis: what it could gain, to first order, from where its search should start.

The gain of a cause whose response is proportional to its size is the projection of the residual on that response,
everything already in the model projected out (score test; Rao 1948).  Others are tried at a few sizes.  Lines
come from a periodogram weighted by the model's own response to an acceleration.
"""

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...sums import along, combined, inner, orthonormal, square
from ..causes import Cause, Hypothesis, Start, Values
from ..data.record import Record
from ..model.nuisance import Problem
from ..model.point import DEVIATIONS, Point, innovations
from .fit import RESOLVED, Fit
from .onsets import sharpest
from .pulses import gusts, losses, moments

IMPULSE_SPACING = 4.0   # s: a corrected model forgets an impulse within it
OWN_SHARE = 1e-9        # of a response's energy that the model cannot make itself: with less it is the model's own
CYCLES = 3.0            # of a line in the log, at least: slower ones are trims
TOP = 0.8               # highest line over the Nyquist frequency
STRONGEST = 3           # lines handed on
OWN_LINE = 4.0          # bins of the periodogram around a line that belong to it


@dataclass(frozen=True)
class Candidate:
    """A hypothesis with starting values and the gain [nats] they promise, before any penalty."""

    hypothesis: Hypothesis
    values: Values
    gain: float


BEGINNING = {Start.ONSET: losses, Start.STEP: moments, Start.PULSE: gusts}


def _inside(hypothesis: Hypothesis, values: Values) -> Values:
    """Starting values within their ranges."""
    return tuple(min(max(value, free.low), free.high) for free, value in zip(hypothesis.free, values, strict=True))


class Projector:
    """Residuals with what is already in the model projected out; `causes` False: a6 and k1 only."""

    def __init__(self, problem: Problem, base: Fit, causes: bool = True) -> None:
        slopes = base.slopes if causes else base.slopes[:, -DEVIATIONS:]
        prior = np.zeros((DEVIATIONS, slopes.shape[1]))
        prior[:, -DEVIATIONS:] = np.diag(1.0 / problem.prior)
        self.residual = problem.residual(base.point)
        self.basis = orthonormal(np.concatenate([slopes, prior]) / norms(slopes))[0]
        self.rest = self.out(self.residual)

    def out(self, vector: np.ndarray) -> np.ndarray:
        """The part of a vector (3n + 5,) that the model's own numbers cannot make."""
        return vector - combined(self.basis, along(self.basis, vector))


def norms(slopes: np.ndarray) -> np.ndarray:
    """The lengths (k,) of the columns of slopes (rows, k), above 0."""
    return np.maximum(np.sqrt(np.einsum("ij,ij->j", slopes, slopes)), 1e-300)


def scan(problem: Problem, base: Fit, hypotheses: Iterable[Hypothesis]) -> list[Candidate]:
    """The best start of every hypothesis that the log could show, best first; those without any gain are left out."""
    project = Projector(problem, base)
    found: list[Candidate] = []
    for hypothesis in hypotheses:
        if not hypothesis.visible(problem.record):
            continue
        if hypothesis.is_line:
            found += [Candidate(hypothesis, values, gain) for values, gain in lines(problem, base)]
            continue
        if hypothesis.start in BEGINNING:
            gain, values = BEGINNING[hypothesis.start](problem, base, project.basis, project.rest)
            tries = [Candidate(hypothesis, _inside(hypothesis, values), gain)]
            if hypothesis.start is not Start.PULSE:
                sharp = [(t,) for t in sharpest(problem, base, hypothesis.start is Start.ONSET)]
                tries += _proportional(problem, base, project, hypothesis, sharp)
            found += [max(tries, key=lambda candidate: candidate.gain)] if gain > 0.0 else []
            continue
        tries = _sized(problem, base, project, hypothesis, hypothesis.sizes(problem.record)) if hypothesis.sizes else \
            _proportional(problem, base, project, hypothesis, hypothesis.shapes(problem.record))
        tries += _sized(problem, base, project, hypothesis, hypothesis.far(problem.record))
        best = max(tries, key=lambda candidate: candidate.gain, default=None)
        if best is not None and best.gain > 0.0:
            found.append(best)
    return sorted(found, key=lambda candidate: -candidate.gain)


def with_effect(base: Fit, cause: Cause) -> Point:
    """The model with one more cause."""
    point = base.point
    return Point((*point.effects, cause.hypothesis.effect(cause.values)), point.deviations)


def response(problem: Problem, base: Fit, project: Projector, hypothesis: Hypothesis, shape: Values) -> np.ndarray:
    """Change of the residual (3n + 5,) per unit of the size, at its neutral value."""
    size = hypothesis.free[0]
    step = size.step if hypothesis.neutral + size.step <= size.high else -size.step
    cause = Cause(hypothesis, (hypothesis.neutral + step, *shape))
    return (problem.residual(with_effect(base, cause)) - project.residual) / step


def _proportional(problem: Problem, base: Fit, project: Projector, hypothesis: Hypothesis,
                  shapes: Sequence[Values]) -> list[Candidate]:
    size, tries = hypothesis.free[0], []
    for shape in shapes:
        whole = response(problem, base, project, hypothesis, shape)
        change = project.out(whole)
        energy = square(change)
        if not energy > OWN_SHARE * square(whole) or not math.isfinite(energy):
            continue
        slope = inner(change, project.rest)
        amount = hypothesis.neutral - slope / energy
        if size.low < amount < size.high:
            tries.append(Candidate(hypothesis, (amount, *shape), 0.5 * slope * slope / energy))
        else:
            inside = min(max(amount, size.low), size.high)
            moved = inside - hypothesis.neutral
            tries.append(Candidate(hypothesis, (inside, *shape), -slope * moved - 0.5 * energy * moved * moved))
    return tries


def _sized(problem: Problem, base: Fit, project: Projector, hypothesis: Hypothesis,
           sizes: Iterable[float]) -> list[Candidate]:
    cost, tries = square(project.rest), []
    for size, shape in itertools.product(sizes, hypothesis.shapes(problem.record)):
        values = (size, *shape)
        rest = project.out(problem.residual(with_effect(base, Cause(hypothesis, values))))
        tries.append(Candidate(hypothesis, values, 0.5 * (cost - square(rest))))
    return tries


# ---- lines


Lines = list[tuple[Values, float]]


def lines(problem: Problem, base: Fit) -> Lines:
    """((amplitude, frequency, phase), gain) of the strongest sinusoidal accelerations, by the gain each promises."""
    record, size = problem.record, 1 << (2 * problem.record.rows - 1).bit_length()
    score, energy = np.zeros(size // 2 + 1, complex), np.zeros(size // 2 + 1)
    for part, transfer in _transfers(problem, base, size):
        data = np.fft.rfft(base.whitened[part], size, axis=0)
        matched = np.sum(np.conj(transfer) * data, axis=1)
        score += matched * np.exp(-2j * math.pi * np.arange(size // 2 + 1) * part.start / size)
        energy += np.sum(np.abs(transfer)**2, axis=1) * float(part.stop - part.start)
    return _strongest(record, score, energy, size)


def _transfers(problem: Problem, base: Fit, size: int) -> Iterator[tuple[slice, np.ndarray]]:
    """(rows, (size/2 + 1, 3)): what an acceleration makes of the whitened innovations, as a transfer function of each
    stretch of the log."""
    record = problem.record
    ticks = record.every // record.tick
    rows = max(2, round(IMPULSE_SPACING / record.period))
    extra = np.zeros(len(record.commands))
    for k in range(0, record.rows - 1, rows):
        extra[k * ticks:(k + 1) * ticks] = 1.0
    moved = innovations(record, problem.filter, base.point, extra)[0]
    impulse = base.whitened - problem.counted(problem.filter.whiten(moved))
    for first in range(0, record.rows - 1, rows):
        part = slice(first, min(first + rows, record.rows))
        yield part, np.fft.rfft(impulse[part], size, axis=0)


def _strongest(record: Record, score: np.ndarray, energy: np.ndarray, size: int) -> Lines:
    """The peaks of a periodogram (size/2 + 1,) with its weights."""
    frequency = 2.0 * math.pi * np.arange(size // 2 + 1) / (size * record.period)
    span = record.rows * record.period
    power = np.abs(score)**2 / np.maximum(energy, 1e-300)
    top = min(TOP * math.pi / record.period, RESOLVED / record.resolution)
    power[(frequency < CYCLES * 2.0 * math.pi / span) | (frequency > top)] = 0.0
    start = record.t[0]
    found: Lines = []
    for _ in range(STRONGEST):
        k = int(np.argmax(power))
        if power[k] <= 0.0:
            break
        phasor = 2.0 * score[k] / energy[k] * 1j * np.exp(-1j * frequency[k] * start)
        values = (float(abs(phasor)), float(frequency[k]), float(np.angle(phasor)))
        found.append((values, float(power[k])))
        own = OWN_LINE * 2.0 * math.pi / span
        power[np.abs(frequency - frequency[k]) < own] = 0.0
    return found
