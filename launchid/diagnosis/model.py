"""Model of the diagnosis: the nominal's vehicle with the usual numbers free.  Frozen: numbers in, parameters out."""

import math
import time
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from ..likelihood.estimate import Noise, Table
from ..likelihood.kernel import ROW, B
from ..likelihood.likelihood import LEVELS, Parameters, Run, nozzle_path, respond
from ..series import filled
from .believed import NEUTRAL, OF_SENSORS, forcing
from .known import CURVES, KnownLog
from .noise import Air, noise_of
from .numbers import usual
from .track import Track

LINEAR_TERMS = ("1", "theta", "theta_dot", "beta")
RESPONSE_STEP = 0.02   # s, about, of small responses between two rows
SIGN_SHARE = 0.05      # of the rms rate, over which a dry friction turns


class Stopped(Exception):
    """Raised when the time limit of [diagnosis] has passed: the diagnosis ends without a conclusion."""


class Path(NamedTuple):
    """The filtered motion along the log, about which the effects of small forces are computed.

    motion (n, 3) attitude, rate, nozzle;  nozzle (n steps,) at the beginning of every step of the filter, for a mode
    may swing faster than rows show;  nozzle_rate (n,) over each row as predicted at its beginning: what is measured at
    its end knows the row's noise;  input (n, steps) of the servo
    force, air (n,) [rad/s^2], shift (n, 3)   by the nominal's own effects: moments, measurements
    """

    motion: np.ndarray
    nozzle: np.ndarray
    nozzle_rate: np.ndarray
    input: np.ndarray
    force: np.ndarray
    air: np.ndarray
    shift: np.ndarray


@dataclass(frozen=True, eq=False)
class Model:
    """A log with a table of numbers: makes the filter's parameters of given values of them.

    table   the numbers, grown by `scan.with_shape`;  shapes  the candidates beyond the usual numbers that stand in it
    levels  (7,) logarithms of the noise levels;  noise  what is believed of them;  bounds  as in `noise_of`
    brake   [s] of the monotonic clock, after which nothing is filtered
    """

    log: KnownLog
    table: Table
    shapes: tuple[Any, ...]
    levels: np.ndarray
    noise: Noise
    air: Air
    path: Path
    bounds: str = "bounded"
    brake: float = math.inf
    columns: dict[tuple[object, ...], Any] = field(default_factory=dict, repr=False)   # a memo, of log and path

    @classmethod
    def of(cls, track: Track, bounds: str = "bounded") -> "Model":
        """Return the model of a track with the usual numbers, levels as declared."""
        return cls.of_log(KnownLog(track, track.z), bounds)

    @classmethod
    def of_log(cls, log: KnownLog, bounds: str = "bounded") -> "Model":
        """Return the model of a log with the usual numbers, levels as declared."""
        track = log.track
        noise, air = noise_of(log, bounds)
        nozzle = np.interp(track.edges[:-1], track.ticks[:-1], track.commands)
        motion = np.column_stack([filled(log.z[:, 0]), filled(log.z[:, 1]), nozzle[::track.sub]])
        path = _path(log, motion, nozzle, np.zeros(log.n), log.base_input)
        return cls(log, Table.of(usual(log)), (), noise.declared, noise, air, path, bounds)

    # ---- the same with something else

    def usual(self) -> "Model":
        """Return the model with the usual numbers alone."""
        return replace(self, table=Table.of(usual(self.log)), shapes=())

    def with_levels(self, levels: np.ndarray) -> "Model":
        return replace(self, levels=levels)

    def in_weather(self, name: str) -> "Model":
        """Return the model in turbulent air, or in a wind that walks (`name`), of a level that is fitted; "": in the
        nominal's.  Levels are as declared."""
        noise, air = noise_of(self.log, self.bounds, name)
        return replace(self, noise=noise, air=air, levels=noise.declared)

    def retime(self, late: float) -> "Model":
        """Return the model with the gyro's column earlier by the whole rows in `late` [s]; itself if there are none: no
        series of few terms says what such a gyro does."""
        log = self.log
        rows = round((late - log.retimed) / log.period)
        if rows < 1:
            return self
        z = log.z.copy()
        z[:-rows, 1] = log.z[rows:, 1]
        z[-rows:, 1] = np.nan
        return replace(self, log=replace(log, z=z, retimed=log.retimed + rows * log.period), columns={})

    def with_commands(self, commands: np.ndarray) -> "Model":
        """Return the model with other commands (ticks,) [rad] as its input."""
        return replace(self, log=replace(self.log, track=replace(self.log.track, commands=commands)), columns={})

    def settled(self, run: Run) -> "Model":
        """Return the model with the filtered motion of a run, from which forced columns are made."""
        log, X = self.log, run.X
        predicted = X[1:, B] - np.sum(run.K[1:, :, B] * run.E[1:], axis=1)
        rate = np.append((predicted - X[:-1, B]) / log.dt[:-1], 0.0)
        nozzle = nozzle_path(run, log.track.period / log.track.sub)
        path = _path(log, np.column_stack([X[:, 0], X[:, 1], X[:, B]]), nozzle, rate, run.parameters.u)
        return replace(self, path=path, columns={})

    # ---- numbers to the filter's parameters

    @property
    def scored(self) -> np.ndarray:
        return self.log.scored

    def parameters(self, p: np.ndarray) -> Parameters:
        """Return the filter's parameters for numbers p; Stopped after the time limit."""
        if time.monotonic() > self.brake:
            raise Stopped
        log, at, path = self.log, self.table.places, self.path

        def get(name: str, missing: float = 0.0) -> float:
            return float(p[at[name]]) if name in at else log.given.get(name, missing)

        c, rows = log.servo_numbers(get), np.zeros(log.n, ROW)
        for name in OF_SENSORS:
            c[name] = get(name, NEUTRAL[name])
        c["gyro_delay"] -= log.retimed
        c["nozzle_bias"] = get("nozzle_bias")
        c["sign_rate"] = max(SIGN_SHARE * log.scales.omega, 1e-9)
        c["walk_time"], c["turbulence_time"] = self.air.walk_time, self.air.turbulence_time
        c["inertia"], c["command_period"] = get("inertia"), log.tick
        for name, place in CURVES.items():
            value = get("term " + name, log.terms.get(name, 0.0))
            (rows if place in (ROW.names or ()) else c)[place] = value
        rows["sine"] += get("sine")
        c["sign"] -= get("friction")
        c["cube"] += get("cubic") * float(np.mean(log.a6))
        self._noise_to(c)
        a6, k1 = log.a6 * get("a6", 1.0), log.k1
        rows["theta"] = a6 + get("term theta", log.terms.get("theta", 0.0)) - get("sine")
        rows["theta_dot"] = get("term theta_dot", log.terms.get("theta_dot", 0.0)) - get("damping")
        beta = k1 * (get("k1", 1.0) + get("k1_slope") * log.about) + \
            get("term beta", log.terms.get("beta", 0.0))
        f = get("moment") + k1 * get("misalignment") + a6 * get("wind") + path.force + \
            get("term 1", log.terms.get("1", 0.0)) + get("a6", 1.0) * path.air
        rows["m"] = log.a6 if self.air.is_windy else 1.0
        rows["g"] = log.a6 if log.is_flown or self.air.is_windy else 1.0
        z, u = log.z - path.shift, log.input_of(get)
        for shape in self.shapes:
            values = tuple(float(p[at[name]]) for name in shape.names)
            if shape.kind.curve:
                c[shape.kind.curve] += values[0]
                continue
            if not any(values[:shape.kind.linear]):
                continue
            beta = beta * shape.effectiveness(self, values)
            force, sent, moved = shape.effect(self, values)
            f = f if force is None else f + force
            u = u if sent is None else u + sent
            z = z if moved is None else z - moved
        rows["force"], rows["beta"] = f, beta
        return Parameters(log.t, np.ascontiguousarray(z), u, rows, c, log.modes)

    def _noise_to(self, c: np.ndarray) -> None:
        """Write the noise levels, and what is known before the first row, to NUMBERS c (1,)."""
        s, level = self.log.scales, dict(zip(LEVELS, np.exp(self.levels), strict=True))
        for name, value in level.items():
            c[name + "_noise"] = value
        c["theta_start"] = (10.0 if self.log.has["theta"] else 100.0) * s.theta**2 + level["theta"]**2
        c["omega_start"] = 10.0 * s.omega**2 + 100.0 * level["theta_dot"]**2
        c["m_start"], c["g_start"] = self.air.start**2, level["turbulence"]**2
        c["b_start"], c["v_start"] = s.beta**2, (10.0 * s.beta)**2
        c["longest_gap"] = self.log.longest_gap

    # ---- what follows from a run

    def response(self, base: Run, force: np.ndarray, command: np.ndarray, shift: np.ndarray) -> np.ndarray:
        """Return the change (r,) of the whitened innovations of a run by a small force (n,) [rad/s^2], command (n,)
        [rad] and shift (n, 3) of the measurements."""
        sub = max(1, round(self.log.track.period / RESPONSE_STEP))
        E = respond(base, force, command, shift, sub)
        return E.ravel()[self.scored] * (1.0 / np.sqrt(base.S.ravel()[self.scored]))


def _path(log: KnownLog, motion: np.ndarray, nozzle: np.ndarray, nozzle_rate: np.ndarray,
          sent: np.ndarray) -> Path:
    """Return the path with what the nominal's own effects do along it."""
    rest = {name: value for name, value in log.terms.items() if name not in CURVES and name not in LINEAR_TERMS}
    return Path(motion, nozzle, nozzle_rate, sent, *forcing(log.known, log.track, rest, motion))
