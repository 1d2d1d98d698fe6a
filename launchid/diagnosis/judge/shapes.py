"""Generic shapes of a misfit at each place: what no cause of the catalogue is, but any of them may leave behind.

Each is a small signal made of what the model believes (attitude, rate, nozzle, command, time), added to the
acceleration, to the command, or to a sensor; its gain is a score, as in `scan`.  A quadratic servo, a bent sensor
characteristic or a drifting scale shows here as its own shape, at its own place.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from ...sums import combined, inner, least_squares, square
from ..data.record import CHANNELS, Record
from ..model.nuisance import Problem
from ..model.point import innovations
from ..search.fit import Fit
from ..search.scan import Projector, lines

PIECE = 1e-4   # rms of a shape when its response is taken: rad, rad/s, rad/s^2; small enough to be linear
NO_ENERGY = 1e-9
SWELL = 6.0    # s between knots of a line that comes and goes
PLAY = 0.3     # half-width of the play that is tried, of the command's rms
SHAPE_SHARE = 1e-4  # of a response's energy that the model cannot make itself: with less it is the model's own


def _signals(fitted: Fit) -> dict[str, np.ndarray]:
    """(n,) each: filtered attitude, rate, nozzle, nozzle rate, command; what each sensor should see before it is read
    (a corrected state holds its noise); and time from -1 to 1."""
    record, x = fitted.record, np.nan_to_num(fitted.states)
    ticks = record.every // record.tick
    expected = np.nan_to_num(record.z - fitted.innovations)
    seen = {f"seen {channel}": expected[:, k] for k, channel in enumerate(CHANNELS)}
    return {**seen, "theta": x[:, 0], "theta_dot": x[:, 1], "beta": x[:, 2], "beta_dot": x[:, 3],
            "u": record.commands[::ticks], "time": np.linspace(-1.0, 1.0, record.rows)}


def _shapes(s: dict[str, np.ndarray]) -> Iterator[tuple[str, str, np.ndarray]]:
    """The shapes: place, name, signal (n,)."""
    for a, b in (("theta", "theta"), ("theta", "theta_dot"), ("theta", "beta"), ("beta", "beta")):
        yield "plant", f"{a}*{b}", s[a] * s[b]
    for a in ("theta", "theta_dot", "beta"):
        yield "plant", f"{a}*abs({a})", s[a] * np.abs(s[a])
        yield "plant", f"{a}*time", s[a] * s["time"]
    yield "plant", "sign(theta_dot)", np.sign(s["theta_dot"])
    yield "plant", "time", s["time"]
    yield "actuator", "sign(beta_dot)", np.sign(s["beta_dot"])
    yield "actuator", "beta_dot*abs(beta_dot)", s["beta_dot"] * np.abs(s["beta_dot"])
    for name, signal in (("u^2", s["u"]**2), ("u*abs(u)", s["u"] * np.abs(s["u"])), ("u^3", s["u"]**3),
                         ("abs(u)", np.abs(s["u"])), ("u*time", s["u"] * s["time"]), ("time", s["time"])):
        yield "actuator", name, signal
    yield "actuator", "play(u)", _play(s["u"]) - s["u"]
    for channel in CHANNELS:
        own = s[f"seen {channel}"]
        for name, signal in ((f"{channel}^2", own**2), (f"{channel}^3", own**3), (f"abs({channel})", np.abs(own)),
                             (f"{channel}*time", own * s["time"]), ("time", s["time"])):
            yield channel, name, signal


def _play(u: np.ndarray) -> np.ndarray:
    """u (n,) through a play of PLAY times its RMS."""
    half, at, found = PLAY * float(np.sqrt(np.mean(u**2))), float(u[0]), np.empty_like(u)
    for k, command in enumerate(u.tolist()):
        at = min(max(at, command - half), command + half)
        found[k] = at
    return found


def shape_gains(problem: Problem, fitted: Fit) -> list[tuple[str, str, float, float]]:
    """(place, name, amplitude, gain [nats]) of every shape that the log can show, the best first."""
    record, found = problem.record, []
    project = Projector(problem, fitted)
    channels = set(record.channels)
    for place, name, signal in _shapes(_signals(fitted)):
        size = float(np.sqrt(np.mean(signal**2)))
        if size == 0.0 or (place in CHANNELS and place not in channels) or \
                (place == "actuator" and not record.command_is_known):
            continue
        piece = signal * (PIECE / size)
        whole = (_moved(problem, fitted, record, place, piece) - project.residual) / PIECE
        change = project.out(whole)
        energy = square(change)
        if energy * PIECE**2 < NO_ENERGY or energy < SHAPE_SHARE * square(whole):
            continue
        slope = inner(change, project.rest)
        found.append((place, name, -slope / energy, 0.5 * slope * slope / energy))
    return sorted(found, key=lambda each: -each[3])


def line_gain(problem: Problem, fitted: Fit, place: str, frequency: float, times: np.ndarray | None = None) -> float:
    """The gain [nats] of a sine of this frequency [rad/s], of any amplitude and phase, at a place.

    times  (k, n), what the sine is multiplied by, each with its own amplitude and phase; None: 1
    """
    turned = frequency * problem.record.t
    return _gain_of(problem, fitted, place, [
        factor * wave for factor in (np.ones((1, problem.record.rows)) if times is None else times)
        for wave in (np.sin(turned), np.cos(turned))])


def swell_gain(problem: Problem, fitted: Fit, frequencies: Iterable[float]) -> tuple[float, float, int]:
    """(gain [nats], frequency [rad/s], knots) of the moment that gains most among lines of these frequencies and the
    strongest of the spectrum, whose amplitude and phase come and go: linear between knots SWELL or two turns apart."""
    t, best = problem.record.t, (0.0, 0.0, 2)
    for frequency in (*frequencies, *(values[1] for values, _ in lines(problem, fitted))):
        apart = max(SWELL, 4.0 * np.pi / frequency)
        knots = np.linspace(t[0], t[-1], max(2, 1 + round((t[-1] - t[0]) / apart)))
        hats = np.array([np.interp(t, knots, each) for each in np.eye(len(knots))])
        best = max(best, (line_gain(problem, fitted, "plant", frequency, hats), frequency, len(knots)))
    return best


def ramp_gain(problem: Problem, fitted: Fit) -> float:
    """The gain [nats] of a moment on a straight line in time."""
    rows = problem.record.rows
    return _gain_of(problem, fitted, "plant", [np.ones(rows), np.linspace(-1.0, 1.0, rows)])


def _gain_of(problem: Problem, fitted: Fit, place: str, signals: list[np.ndarray]) -> float:
    """The gain [nats] of signals (n,) at a place together, each of any amplitude."""
    project, changes = Projector(problem, fitted), []
    for signal in signals:
        size = PIECE / max(float(np.sqrt(np.mean(signal**2))), NO_ENERGY)
        changes.append(project.out(_moved(problem, fitted, problem.record, place, size * signal) - project.residual)
                       / size)
    slopes = np.column_stack(changes)
    return 0.5 * square(combined(slopes, least_squares(slopes, project.rest, NO_ENERGY)))


def _moved(problem: Problem, fitted: Fit, record: Record, place: str, piece: np.ndarray) -> np.ndarray:
    """Residual (3n + 5,) with a shape added."""
    ticks = record.every // record.tick
    extra, changed = None, record
    if place == "plant":
        extra = np.repeat(piece, ticks)
    elif place == "actuator":
        changed = replace(record, commands=record.commands + np.repeat(piece, ticks))
    else:
        z = record.z.copy()
        z[:, CHANNELS.index(place)] -= piece
        changed = replace(record, z=z)
    e = innovations(changed, problem.filter, fitted.point, extra)[0]
    white = problem.counted(problem.filter.whiten(e))
    return np.concatenate([white.ravel(), np.array(fitted.point.deviations) / problem.prior])
