"""Feed the estimator of `identify --nominal --tracked` while rows come; its numbers for the page go to `live`."""

import dataclasses
import itertools
import math
import time
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from launchid_core import EDGES, Config, Estimate, EstimateStatus, Estimator, Status
from sim.errors import InputError, Told, UsageError
from sim.nominal import Nominal
from sim.onboard import onboard_model

from ..formatting import json_number, servo_lines
from ..identification.config import log_config
from ..judge.refusal import disbelieved
from ..log.commanded import LiveNozzle, blind, said_of
from ..log.live import LiveCheck
from ..log.log import Log, log_of
from ..report.identification import REASONS, actuator_json, change_json, report, tracked_json
from ..robustness.level import level_json, ranged_model
from .last_rows import LastRows
from .live import Live, Row
from .rate import Rate

LAST_WINDOWS = 4096   # that the report at the end holds: an hour of windows of 1 s
SPACING = 0.1         # s of the log between points of the tracked estimate, which moves once in a block as long
FRAME = 0.05          # s of the clock between looks at the newest numbers: 20 a second
STAMPS = ("t", "out_since")  # of a JSON
PAUSE = 1.0           # s of the clock without a row, after which those that wait for others are used
SIGNIFICANT_DIGITS = 7  # significant ones that a page is told: beyond any standard deviation
CURVE = 400           # points of the nominal's profile
WINDOW_ROWS = 100_000  # of a window at a rate that rows say: 9 MB
MOST_WAITING = 4096   # pieces of the log that wait for its period: 64 rows do, among others that say nothing of it
OTHER_RATE = 1.5      # periods from one row to the next, or so many rows in one: another rate


class Follower:
    """Estimator fed while rows come: `take` feeds rows, `tick` refreshes the page, `report` returns identify's JSON.

    `prepare` loads the compiled code; call it before the first row, so that no row waits for it.

    period   [s] between samples; None: median step of the first PERIOD_ROWS rows, which wait for it.  Rows without a
             usable period are skipped; until a window is valid, rows of another period start the estimator anew
    strict   raise InputError where the data check finds a fault
    say      called with each line of text for the user
    """

    def __init__(self, source: str, nominal: Nominal, *, window: float = 1.0, period: float | None = None,
                 noise: str = "estimated", strict: bool = False,
                 say: Callable[[str], None] = lambda text: None) -> None:
        self._source, self._nominal, self._window, self._noise, self._say = source, nominal, window, noise, say
        self._strict = strict
        onboard_model(nominal)
        clock = nominal.sensors if nominal.controller is None else nominal.controller
        self._ready = self._config(clock.period if period is None else period)
        self.estimator: Estimator | None = None
        self._is_prepared = False
        self.rows, self.closed, self._until_point = 0, 0, 0
        self._t, self._shown, self._came = math.nan, -math.inf, math.inf
        self.estimates: deque[Estimate] = deque(maxlen=LAST_WINDOWS)
        self._notes: list[str] = []
        self._last_rows, self._rate, self._stand = LastRows(source, window), Rate(source), (False, "")
        self._waiting: deque[Log] = deque(maxlen=MOST_WAITING)  # until the period is known
        self._live_check = LiveCheck(self._ready.sample_period)
        self._nozzle: LiveNozzle | None = None   # of rows without beta
        self._flew_from = -math.inf   # s, the end of the pad that was left out
        self._is_known, self._refused = period is not None, ""  # is the period sure; why the last one was not used
        self.live = Live(self._head())

    def prepare(self) -> None:
        """Load the estimator's compiled code (or compile it); if the period was given, rows can be fed after it."""
        if self._is_prepared:
            return
        self._is_prepared = True
        self.live.now = {"state": "compiling"}
        self.live.revision += 1
        ready = Estimator(self._ready)
        if self._is_known:
            self.estimator = ready
            self.live.head = self._head()
        self.live.now = {"state": "waiting"}
        self.live.revision += 1

    def _config(self, period: float) -> Config:
        """Return the configuration of `identify` for a log of this period [s], with the nominal's range if it has
        [uncertainty]; the range changes no other number."""
        if not 0.0 < period < math.inf:
            raise UsageError(f"--period {period!r}: expected a time in s above 0")
        timing = log_of({"t": [0.0, period], "theta": [0.0, 0.0], "beta": [0.0, 0.0]}, self._source)
        config = log_config(timing, self._nominal, str(self._window), "filtered", True, library="rigid-body",
                            noise=self._noise)
        if self._nominal.uncertainty is None:
            return config
        return dataclasses.replace(config, model=ranged_model(self._nominal, period, self._source))

    # ---- rows

    def take(self, log: Log) -> None:
        """Feed further rows to the estimator and the data check, or keep them while the period is not known yet."""
        self.prepare()
        log = self._driven(log)
        self.rows, self._came = self.rows + len(log.t), time.monotonic()
        for part, period in [(log, None)] if self._is_known else self._rate.parts(log):
            self._last_rows.add(part)
            if self.estimator is None:
                self._waiting.append(part)
            else:
                self._feed(self._live_check.add(part))
            if period is not None and not self._is_known:
                self._try(period)
        if self.estimator is not None:
            self.check(ended=False)

    def _driven(self, log: Log) -> Log:
        """Return rows of commands alone with the nozzle that the nominal's servo makes of them, others as they are."""
        if "beta" in log.columns or "beta_cmd" not in log.columns or self._nominal.actuator is None:
            return log
        if self._nozzle is None:
            self._note(said_of(log, self._nominal))
            self._nozzle, self._nominal = LiveNozzle(self._nominal), blind(self._nominal)
            if self.estimator is not None:
                self._begin(self.estimator.config.sample_period)
        return self._nozzle.add(log)

    def end(self) -> None:
        """Take all rows that still wait for their period to be known, as no more rows come; InputError if they are too
        few to tell a period."""
        if self.estimator is None:
            try:
                self._begin(self._rate.of_few())
            except Told as error:
                raise InputError(self._refused or str(error)) from None
        self.feed_rest()
        self.check(ended=True)

    def feed_rest(self) -> None:
        """Feed the rows that the row-by-row check holds back until later rows come."""
        if self.estimator is not None:
            self._feed(self._live_check.rest())

    def _try(self, period: float) -> None:
        """Start the estimator with this period [s] of the last rows, unless it runs with one near it (OTHER_RATE)."""
        if self.estimator is not None:
            before = self.estimator.config.sample_period
            if before / OTHER_RATE < period < before * OTHER_RATE:
                return
        try:
            self._begin(period)
        except Told as error:
            if not self._refused:
                self._note(f"{error}; other rows are waited for")
            self._refused = str(error)
            self._waiting.clear()

    def _begin(self, period: float) -> None:
        """Start an estimator with this period [s] and feed rows that waited; UsageError or InputError if it fails."""
        if self._window / period > WINDOW_ROWS:
            raise InputError(f"{self._source}: column t: its median step is {period:g} s; "
                             f"expected at most {WINDOW_ROWS} "
                             f"rows in a window of {self._window:g} s, or --period")
        self.estimator, self._live_check = Estimator(self._config(period)), LiveCheck(period)
        self.live.head, self._last_rows = self._head(), LastRows(self._source, self._window)
        while self._waiting:
            if len(self._waiting) == 1:   # those before may be of another clock
                self._last_rows.add(self._waiting[0])
            self._feed(self._live_check.add(self._waiting.popleft()))
        if self.estimator.config.missing_commands > 0.0:
            self._note(f"{self._source}: slower than the controller: the commands between its rows are taken as held, "
                       "and the standard deviations are wider for it")

    def check(self, ended: bool) -> None:
        """Run the data check if due or `ended`, and judge shown windows by it; InputError for faults if `strict`."""
        assert self.estimator is not None
        if words := self._last_rows.checked(self._nominal, self.estimator.config.sample_period, ended):
            if self._strict:
                raise InputError(words)
            self._note(words)
        self._leave_pad()
        stand = self._last_rows.is_asked, self._last_rows.foreign
        if stand != self._stand:   # that of earlier windows, too
            self._stand, closed = stand, {instant(e.t_end): e for e in self.estimates}
            windows = self.live.windows
            windows.rows = [window_row(self._judged(closed[row[1]])) if row[1] in closed else row
                            for row in windows.rows]
            self.live.revision += 1

    def _leave_pad(self) -> None:
        """Begin the estimator anew behind the pad, where nothing moves that could be identified."""
        end = self._last_rows.pad_until
        if end <= self._flew_from:
            return
        assert self.estimator is not None
        self._flew_from = end
        self._note(f"{self._source}: the pad holds it until {end:.6g} s: the estimator begins anew there")
        self.feed_rest()
        rows = self._last_rows.after(end)
        self.estimates.clear()
        self.closed, self.live.windows.rows = 0, []
        self.estimator, self._live_check = Estimator(self.estimator.config), LiveCheck(
            self.estimator.config.sample_period)
        for piece in rows:
            self._feed(self._live_check.add(piece))

    def _judged(self, estimate: Estimate) -> Estimate:
        """Return the estimate, not valid if the data check of the rows so far is outstanding or found wrong columns."""
        if self._last_rows.foreign:
            return disbelieved(estimate)
        if self._last_rows.is_asked:
            return estimate
        tracked, status = estimate.tracked, EstimateStatus.UNCHECKED if estimate.valid else estimate.status
        return dataclasses.replace(estimate, valid=False, status=status,
                                   tracked=None if tracked is None else tracked._replace(valid=False))

    def _note(self, text: str) -> None:
        if text not in self._notes:
            self._notes = [*self._notes, text]
            self._say(text)

    def _feed(self, logs: Iterator[Log]) -> None:
        """Feed rows that the row-by-row check has passed, and keep each window that closes."""
        assert self.estimator is not None
        update = self.estimator.update
        for sample in itertools.chain.from_iterable(log.samples() for log in logs):
            status = update(sample)
            if status >= 0:
                self._t = sample.t
            if status == Status.WINDOW_COMPLETE:
                self._close(self.estimator)
            self._until_point -= 1
            if self._until_point <= 0:
                self._point(self.estimator)

    def _close(self, estimator: Estimator) -> None:
        estimate = estimator.estimate()
        assert estimate is not None
        self.estimates.append(estimate)
        self.closed += 1
        self._is_known |= estimate.valid
        self.live.windows.add(window_row(self._judged(estimate)))
        self.live.revision += 1

    def _point(self, estimator: Estimator) -> None:
        """Add the tracked estimate as a point of the page's curve, if the curve keeps the next one."""
        points = self.live.points
        self._until_point = max(1, round(SPACING / estimator.config.sample_period))
        estimate = estimator.estimate() if points.is_due() else None
        points.add(None if estimate is None else point_row(self._t, self._judged(estimate)))
        self.live.revision += 1

    # ---- what is shown

    def tick(self, state: str = "following", malformed: int = 0, last: str = "") -> None:
        """Write the newest numbers to `live` for the page, at most every FRAME [s], or at once if `state` has changed.

        malformed, last   how many rows could not be read, and the message about the last of them
        """
        clock = time.monotonic()
        if clock - self._came > PAUSE:
            self.feed_rest()
        if self.estimator is None and state != "ended":
            state = "waiting"
        if state == self.live.now["state"] and clock - self._shown < FRAME:
            return
        self._shown = clock
        now = {"state": state, "rows": self.rows, "malformed": malformed, "last_malformed": last, "notes": self._notes,
               **self._numbers()}
        if {**self.live.now, "clock": 0.0} != {**now, "clock": 0.0}:
            self.live.now = {**now, "clock": clock}
            self.live.revision += 1

    def _numbers(self) -> dict[str, Any]:
        if self.estimator is None:
            return {}
        estimate, counts = self.estimator.estimate(), report([], self.estimator)["samples"]
        known = {"t": instant(self._t), **counts}
        if estimate is None:
            return known
        self.live.changes = [_rounded(change_json(change)) for change in self.estimator.changes()]
        window = self._judged(estimate)
        levels = window.uncertainty
        return {**known, "windows": self.closed, "window": window_row(window),
                "why": REASONS.get(window.status.name, ""), "tracked": _rounded(tracked_json(window)),
                "servo": "".join(servo_lines(actuator_json(window).get("actuator", {}))),
                "level": None if levels is None or not levels.valid else
                {name: _rounded(level_json(getattr(levels, name))) for name in ("a6", "k1")}}

    def _head(self) -> dict[str, Any]:
        nominal, period = self._nominal, None if self.estimator is None else self.estimator.config.sample_period
        return {"source": self._source, "nominal": nominal.name, "window": self._window,
                "period": None if period is None else rounded(period), "edges": list(EDGES),
                "has_wind": nominal.wind is not None and nominal.sensors.alpha_source == "inertial",
                "curve": nominal_curve(nominal)}

    def report(self) -> dict[str, Any]:
        """Return identify's JSON of the last LAST_WINDOWS windows, without the fits, which need the whole log."""
        assert self.estimator is not None
        flown = [e for e in self.estimates if e.t_end <= self._last_rows.flown_until]
        if len(flown) < len(self.estimates):
            self._note(f"{self._source}: from {self._last_rows.flown_until:.6g} s on beta does not move the vehicle: "
                       f"{len(self.estimates) - len(flown)} windows are left out")
        answer = report([self._judged(e) for e in flown], self.estimator, tracked=True)
        return answer | {"earlier_windows": self.closed - len(self.estimates)}


def rounded(x: float) -> float | None:
    """Return a number rounded to SIGNIFICANT_DIGITS, None if it is not finite, for JSON."""
    return json_number(float(f"{x:.{SIGNIFICANT_DIGITS}g}"))


def instant(t: float) -> float | None:
    """Return a time stamp [s] rounded to 0.1 ms, None if it is not finite, for JSON."""
    return json_number(round(t, 4)) if math.isfinite(t) else None


def _rounded(given: Any, name: str = "") -> Any:
    """Return a JSON value with each float rounded, by `instant` if its key is in STAMPS, else by `rounded`."""
    if isinstance(given, dict):
        return {key: _rounded(value, key) for key, value in given.items()}
    if not isinstance(given, float):
        return given
    return instant(given) if name in STAMPS else rounded(given)


def window_row(estimate: Estimate) -> Row:
    """Return a window's estimate as a row in the order of `live.WINDOW_COLUMNS`, numbers rounded."""
    return (instant(estimate.t_start), instant(estimate.t_end), estimate.status.name,
            *(rounded(getattr(estimate, name)) for name in ("a6", "a6_std", "k1", "k1_std")))


def point_row(t: float, estimate: Estimate) -> Row:
    """Return the tracked estimate at time t [s] as a row in the order of `live.POINT`; None for what is not finite."""
    tracked, levels = estimate.tracked, estimate.uncertainty
    assert tracked is not None
    values = [tracked.a6, tracked.a6_std, tracked.k1, tracked.k1_std, estimate.wind, estimate.wind_std]
    for name in ("a6", "k1"):
        values += [math.nan] * 2 if levels is None or not levels.valid else [
            getattr(levels, name).delta, getattr(levels, name).delta_std]
    return (instant(t), *map(rounded, values))


def nominal_curve(nominal: Nominal) -> dict[str, list[float]]:
    """Return name -> values over time of t, a6, k1 and their ranges' half widths; one point if all are constant."""
    sigma = nominal.uncertainty
    times = [nominal.vehicle.t, *([] if sigma is None else [sigma.t])]
    nodes = np.unique(np.concatenate([t for t in times if len(t) > 1] or [np.zeros(1)]))
    t = nodes if len(nodes) == 1 else np.linspace(nodes[0], nodes[-1], CURVE)
    curves = {"t": t}
    for name, value, spread in zip(("a6", "k1"), nominal.vehicle.at(t),
                                   (np.zeros(len(t)),) * 2 if sigma is None else sigma.at(t), strict=True):
        curves |= {name: value, f"{name}_half": np.abs(value) * spread}
    return {name: [float(f"{x:.{SIGNIFICANT_DIGITS}g}") for x in values.tolist()] for name, values in curves.items()}
