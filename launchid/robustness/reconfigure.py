"""Acting on the estimate: PD gains rescheduled in flight, and the closed loop that flies with them.

The rule.  A PD on theta_ddot = a6 theta + k1 beta gives s^2 + kd |k1| s + kp |k1| - a6, so a bandwidth wn and a
damping zeta ask for kp = (wn^2 + a6)/|k1|, kd = 2 zeta wn/|k1|.  wn(t), zeta(t) are those that the legacy gains give at
the nominal: wn^2 = kp |k1_0(t)| - a6_0(t), 2 zeta wn = kd |k1_0(t)|.  With them kd |k1|, and with it everything that
the actuator's, the hold's and the pseudo-derivative's lags take from the loop at high frequency, is the nominal's.
wn is at least max(sqrt(a6), 1 rad/s): below sqrt(a6) the gain kp |k1| would be less than twice what it has to beat.

What is believed.  At each closed window the tracked a6, k1, as ratios to the nominal, which carry them on between
windows.  The window is short: the tracked estimate has all data whatever the window, which only says how often it may
be read, and 0.2 s after the alarm of a lost k1 it knows what is left to 3 %.  (`Estimator.changes` gives the size of a
change two seconds later, so only its alarm is used.)  An estimate is used while it predicts wn^2 better than NOT_SURE.
In wind a6, which the wind multiplies, is known late and k1 well; then k1 alone is used, while it predicts kp |k1|, the
loop's gain, as well: kp_0 |k1_0|/|k1| and kd_0 |k1_0|/|k1| give the loop the nominal's gain at all frequencies, and
what a6 does to wn^2 is what it does to the legacy loop.  A worse one still is used while the legacy gains are beyond
doubt the worse choice: where it says that they miss wn^2 by more than DOUBT_SIGMAS of its standard deviations, as
after a loss of k1 that wind leaves known to 10 %.  Else the ratios are 1, which gives the legacy gains back to the
bit, but for HOLD after an alarm, when the estimate has just been opened and the last belief is the better one.
Without a bump: the controller's only memory is the error and its filtered derivative, which know no gains, and the
gains move at a limited rate.

Assumptions: kp, kd > 0 and k1 < 0, as in all nominals; a nominal without [vehicle.terms] (`onboard_model`'s).
Limitation: the supervisor looks every SUPERVISION seconds, as a slower task beside the controller would.

The gate.  Other gains than the legacy ones are adopted only while the loop with them keeps what the nominal's [margins]
requires with the whole of its 95 % intervals, as the tracked estimate knows a6 and k1, behind the servo as the nominal
declares it or, where it is not known, as the flight has shown it; else the legacy gains stay, or come back, unless they
keep even less of every margin that is missed: a gate that left those to a vehicle that needs others lost one flight
more of 16 (`vega_like`, `both`).  Why is in `Flown.decisions`.  This is a decision of the host: the margins are not
computed on board.
"""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from launchid_core import Change, Config, Estimate, Estimator, Sample, Status, Tracked
from sim.errors import InputError
from sim.flight import prepare, steering
from sim.nominal import Nominal
from sim.onboard import onboard_model
from sim.plant import CLOCK_DIGITS, Factor
from sim.vehicle.record import LOG_ROW, Vehicle

from .flight_margins import Servo, declared_servo, judged, miss_words, servo_at
from .flown import Judged as Controller

READING_PERIOD = 0.2  # s of the estimator: how often the tracked estimate is read
JUDGEMENT_LASTS = 1.0  # s for which a judgement of the margins holds, if the gains asked for stay within
MOVED = 0.01          # of those that were judged
MIN_SAMPLES = 5       # samples in it
HOLD = 0.5            # s after an alarm in which an estimate that is not sure leaves the last belief
TRUTH_DELAY = 0.2     # s, of who knows the truth: as long as the estimate of a lost k1 needs
SUPERVISION = 0.1     # s, between looks at the estimator: its own block of samples
MIN_BANDWIDTH = 1.0   # rad/s, least wn: slower than guidance, the attitude would not follow
MIN_GAIN = 1.0        # of the legacy gain.  The rule asks for less when the vehicle is stiffer than believed, and what
# is given away then is missing when k1 is lost: with 0.5 one of 100 constant flights was lost (`both`) that legacy
# keeps, for 2 % less nozzle rate.  Legacy flies the whole box with it
MAX_GAIN = 2.5        # of the legacy gain.  45 % of k1 lost and a6 up 60 % ask for 2.1 to 2.3; beyond, the estimate is
# wrong.  A true nominal k1 bears it at maximum a6 (high-frequency gain margin 3.2 and more), not at the VEGA-like's
# end (2.0): there NOT_SURE alone stands against a wrong estimate
GAIN_RATE = 4.0       # of the legacy gain, 1/s: the 1.8 that a loss of 45 % asks for is there in 0.2 s, as long as the
# estimate needed.  In 100 greensite flights that lose 45 %: 30 lost at 1/s, 21 at 4/s, 18 at 20/s, where a period of
# the controller could step the command by 20 % of it
DOUBT_SIGMAS = 1.96   # standard deviations, 95 %
NOT_SURE = 0.15       # std of wn^2 relative to itself; a box of sigma 0.25 alone makes it 0.19: no better, no change


class Belief(NamedTuple):
    """The scheduler's a6 and k1, each as a ratio to the nominal's; (1, 1) is the nominal."""

    a6: float
    k1: float


NOMINAL_BELIEF = Belief(1.0, 1.0)


@dataclass(frozen=True)
class Rule:
    """The gain schedule of one nominal: PD gains for a given a6 and k1.  InputError unless kp, kd > 0 and k1 < 0."""

    nominal: Nominal

    def __post_init__(self) -> None:
        self.nominal.require("controller")
        controller, path = self.nominal.controller, self.nominal.path
        assert controller is not None
        if not (controller.kp > 0 and controller.kd > 0 and np.all(self.nominal.vehicle.k1 < 0)):
            raise InputError(f"{path}: controller.kp = {controller.kp!r}, kd = {controller.kd!r} with k1 up to "
                             f"{float(np.max(self.nominal.vehicle.k1))!r}: expected kp, kd > 0 and k1 < 0")

    @property
    def legacy(self) -> tuple[float, float]:
        """Return (kp, kd [s]) of the nominal file."""
        controller = self.nominal.controller
        assert controller is not None
        return controller.kp, controller.kd

    def at(self, t: float) -> tuple[float, float]:
        """Return the nominal's (a6, k1) [1/s^2] at t [s]."""
        a6, k1 = self.nominal.vehicle.at(np.array(t))
        return float(a6), float(k1)

    def gains(self, t: float, belief: Belief) -> tuple[float, float]:
        """Return (kp, kd [s]) with the legacy loop's bandwidth and damping at t [s] for this belief, within the limits.

        Written as what changes against the legacy gains, so that the nominal's belief gives them to the bit.
        """
        kp, kd = self.legacy
        a6_0, k1_0 = self.at(t)
        a6, k1 = a6_0 * belief.a6, abs(k1_0 * belief.k1)
        wn2, least = kp * abs(k1_0) - a6_0, max(a6, MIN_BANDWIDTH**2)
        faster = math.sqrt(least / wn2) if 0.0 < wn2 < least else 1.0
        new_kp = kp * (abs(k1_0) / k1) + (a6 - a6_0 + max(least - wn2, 0.0)) / k1
        new_kd = kd * (abs(k1_0) / k1) * faster
        return min(max(new_kp, MIN_GAIN * kp), MAX_GAIN * kp), min(max(new_kd, MIN_GAIN * kd), MAX_GAIN * kd)

    def spread(self, t: float, tracked: Tracked) -> float:
        """Return the relative std of wn^2 = kp |k1| - a6 at t [s], with gains chosen from the tracked a6 and k1."""
        kp, _ = self.legacy
        a6_0, k1_0 = self.at(t)
        wn2 = max(kp * abs(k1_0) - a6_0, MIN_BANDWIDTH**2)
        gain = (wn2 + tracked.a6) / abs(tracked.k1)
        s_a, s_k = tracked.a6_std, gain * tracked.k1_std
        return math.sqrt(max(s_a**2 + s_k**2 + 2.0 * tracked.a6_k1_corr * s_a * s_k, 0.0)) / wn2

    def spread_of_k1(self, t: float, tracked: Tracked) -> float:
        """Return the relative std of wn^2 = kp |k1| - a6 at t [s] from k1's error alone, with a6 the nominal's."""
        kp, _ = self.legacy
        a6_0, k1_0 = self.at(t)
        wn2 = max(kp * abs(k1_0) - a6_0, MIN_BANDWIDTH**2)
        return (wn2 + a6_0) * tracked.k1_std / abs(tracked.k1) / wn2

    def missed(self, t: float, tracked: Tracked) -> float:
        """Return by what share the legacy gains' wn^2 = kp |k1| - a6 falls below the nominal's if `tracked` is true."""
        kp, _ = self.legacy
        a6_0, k1_0 = self.at(t)
        wn2 = kp * abs(k1_0) - a6_0
        return (wn2 - (kp * abs(tracked.k1) - tracked.a6)) / max(wn2, MIN_BANDWIDTH**2)

    def believe(self, t: float, tracked: Tracked | None) -> Belief | None:
        """Return the tracked a6 and k1 at t [s] as ratios to the nominal's (a6: 1 if only k1 is certain enough); None
        if the estimate is missing, invalid or too uncertain."""
        if tracked is None or not tracked.valid or not all(map(math.isfinite, tracked)) or tracked.k1 >= 0.0:
            return None
        a6_0, k1_0 = self.at(t)
        if self.spread(t, tracked) <= NOT_SURE:
            return Belief(tracked.a6 / a6_0 if a6_0 != 0.0 else 1.0, tracked.k1 / k1_0)
        if self.spread_of_k1(t, tracked) <= NOT_SURE:
            return Belief(1.0, tracked.k1 / k1_0)
        if self.missed(t, tracked) > DOUBT_SIGMAS * self.spread(t, tracked):
            return Belief(tracked.a6 / a6_0 if a6_0 != 0.0 else 1.0, tracked.k1 / k1_0)
        return None


class Scheduler:
    """A gain scheduler beside the controller: belief of a6 and k1 from samples, and the gains (kp, kd [s]) in use."""

    def __init__(self, nominal: Nominal) -> None:
        self.rule = Rule(nominal)
        self.belief = NOMINAL_BELIEF
        self.gains = self.rule.legacy

    def take(self, samples: list[Sample]) -> None:
        """Update the belief from new samples, one at least; a subclass says how."""
        raise NotImplementedError

    def target(self, t: float) -> tuple[float, float]:
        """Return the gains (kp, kd [s]) that the rule gives the present belief at t [s]."""
        return self.rule.gains(t, self.belief)

    def move(self, target: tuple[float, float], dt: float) -> tuple[float, float]:
        """Move the gains towards `target` for dt [s], at most GAIN_RATE; store and return them (kp, kd [s])."""
        kp, kd = (now + min(max(to - now, -GAIN_RATE * legacy * dt), GAIN_RATE * legacy * dt)
                  for now, to, legacy in zip(self.gains, target, self.rule.legacy, strict=True))
        self.gains = kp, kd
        return self.gains


class Decision(NamedTuple):
    """Whether the gate adopts gains (kp, kd [s]) at t [s]; reason: the margins that they miss, "" if none."""

    t: float
    adopted: bool
    gains: tuple[float, float]
    reason: str


class Gate:
    """Lets new gains pass only if the nominal's required margins hold with them, or the legacy gains keep less.

    fitted  the controller that a log told, with what is not known of it, in place of the nominal's
    """

    def __init__(self, nominal: Nominal, fitted: Controller | None = None) -> None:
        self.nominal = nominal
        self.fitted = fitted
        self.declared = declared_servo(nominal)
        self.last = Decision(-math.inf, True, (math.nan, math.nan), "")

    def judge(self, t: float, tracked: Tracked, gains: tuple[float, float], servo: Servo | None = None) -> Decision:
        """Return the decision on gains (kp, kd [s]) at t [s] behind `servo` (None: as declared); the last decision
        again if it is younger than JUDGEMENT_LASTS and the gains have moved less than MOVED."""
        servo = self.declared if servo is None else servo
        near = all(abs(new / old - 1.0) < MOVED for new, old in zip(gains, self.last.gains, strict=True))
        if near and t - self.last.t < JUDGEMENT_LASTS:
            return self.last
        rigid, required = tuple(tracked)[1:], self.nominal.margins
        spread = judged(self.nominal, rigid, servo, gains, self.fitted).spread
        if spread is None:
            self.last = Decision(t, False, gains, "the tracked estimate is not finite")
            return self.last
        missed = spread.below(required)
        reason = "; ".join(miss_words(spread, name, required) for name in missed)
        legacy = judged(self.nominal, rigid, servo, None, self.fitted).spread if missed else None
        worse = legacy is not None and all(legacy.ends(name)[0] < spread.ends(name)[0] for name in missed)
        self.last = Decision(t, not missed or worse, gains, reason + ("; the legacy gains keep less" if worse else ""))
        return self.last


class Supervisor(Scheduler):
    """The scheduler that flies: it believes the on-board estimator, unless the gate refuses the gains that follow."""

    def __init__(self, nominal: Nominal, sample_period: float) -> None:
        super().__init__(nominal)
        self.gate = Gate(nominal)
        self.decisions: list[Decision] = []
        self.estimator = Estimator(Config(window=max(READING_PERIOD, MIN_SAMPLES * sample_period),
                                          sample_period=sample_period,
                                          formulation="filtered", model=onboard_model(nominal)))

    def take(self, samples: list[Sample]) -> None:
        """Feed samples to the estimator; after each closed window update the belief, and note the gate's decision."""
        for sample in samples:
            if self.estimator.update(sample) == Status.WINDOW_COMPLETE:
                estimate = self.estimator.estimate()
                assert estimate is not None
                changes = self.estimator.changes()
                held = self.belief if changes and estimate.t_end - changes[-1].alarm < HOLD else NOMINAL_BELIEF
                self.belief = self.passed(estimate, self.rule.believe(estimate.t_end, estimate.tracked) or held)

    def passed(self, estimate: Estimate, belief: Belief) -> Belief:
        """Return the belief, or the nominal's if the gate refuses its gains; a change of adoption goes to
        `decisions`."""
        gains = self.rule.gains(estimate.t_end, belief)
        if gains == self.rule.legacy or estimate.tracked is None:
            return belief
        decision = self.gate.judge(estimate.t_end, estimate.tracked, gains, servo_at(self.gate.declared, estimate))
        if not self.decisions or decision.adopted != self.decisions[-1].adopted:
            self.decisions.append(decision)
        return belief if decision.adopted else NOMINAL_BELIEF


class Knowing(Scheduler):
    """A scheduler that believes the true ratios of a6 and k1, TRUTH_DELAY late: no estimator can do better, so the
    flights that it loses are lost by the rule itself."""

    def __init__(self, nominal: Nominal, a6_factor: Factor, k1_factor: Factor) -> None:
        super().__init__(nominal)
        self.factors = a6_factor, k1_factor

    def take(self, samples: list[Sample]) -> None:
        """Set the belief to the true factors at the last sample's time less TRUTH_DELAY."""
        t = np.array(max(samples[-1].t - TRUTH_DELAY, 0.0))
        self.belief = Belief(*(float(factor(t)) if callable(factor) else factor for factor in self.factors))


@dataclass(frozen=True, eq=False)
class Flown:
    """A flight in closed loop: log rows (n,) of dtype `record.LOG_ROW`, `period` [s] apart, and the gains (n, 2) kp, kd
    [s] flown; the estimator's sudden changes and the gate's decisions."""

    rows: np.ndarray
    gains: np.ndarray
    period: float     # s, of the rows
    lost: bool
    changes: tuple[Change, ...] = ()
    decisions: tuple[Decision, ...] = ()  # of the gate

    def column(self, name: str) -> np.ndarray:
        """Return column `name` of the log (n,), SI units."""
        return self.rows[name]


def fly_legacy(nominal: Nominal, seed: int = 0, a6_factor: Factor = 1.0, k1_factor: Factor = 1.0) -> Flown:
    """Fly the nominal with its own gains; the factors multiply its a6 and k1."""
    vehicle, steps = prepare(nominal, seed, "flight", None, a6_factor, k1_factor)
    state = vehicle.flight[0]
    every = int(state.log_every)
    rows = np.empty(-(-steps // every), LOG_ROW)
    steering(nominal, vehicle)(vehicle, steps, rows)
    rows = rows[:int(state.rows)]
    gains = np.tile([state.kp, state.kd], (len(rows), 1))
    return Flown(rows, gains, every * float(state.step), bool(state.lost))


def fly_reconfigured(nominal: Nominal, seed: int = 0, a6_factor: Factor = 1.0, k1_factor: Factor = 1.0,
                     believed: Nominal | None = None) -> Flown:
    """Fly with gains that follow the estimates, with the noise of `fly_legacy`; the factors multiply a6 and k1.

    believed   the nominal that the supervisor uses, if it is not the one that flies
    """
    vehicle, steps = prepare(nominal, seed, "flight", None, a6_factor, k1_factor)
    state = vehicle.flight[0]
    supervisor = Supervisor(believed or nominal, int(state.log_every) * float(state.step))
    flown = _fly(vehicle, steps, supervisor, steering(nominal, vehicle, believed))
    return dataclasses.replace(flown, changes=supervisor.estimator.changes(), decisions=tuple(supervisor.decisions))


def fly_knowing(nominal: Nominal, seed: int = 0, a6_factor: Factor = 1.0, k1_factor: Factor = 1.0) -> Flown:
    """Fly with gains that follow the true a6 and k1, TRUTH_DELAY late; the same noise as `fly_legacy`."""
    vehicle, steps = prepare(nominal, seed, "flight", None, a6_factor, k1_factor)
    return _fly(vehicle, steps, Knowing(nominal, a6_factor, k1_factor), steering(nominal, vehicle))


FlyOn = Callable[[Vehicle, int, np.ndarray], None]


def _fly(vehicle: Vehicle, steps: int, scheduler: Scheduler, fly_on: FlyOn) -> Flown:
    """Fly `steps` steps with the scheduler's gains; it sees new rows every SUPERVISION seconds."""
    state = vehicle.flight[0]
    h, every, tick = float(state.step), int(state.log_every), int(state.control_every)
    rows = np.empty(-(-steps // every), LOG_ROW)
    gains = np.empty((len(rows), 2))
    turn = max(1, round(SUPERVISION / (tick * h))) * tick
    for start in range(0, steps, turn):
        seen = int(state.rows)
        _fly_turn(vehicle, scheduler, fly_on, range(start, min(start + turn, steps), tick), rows, gains)
        if state.lost:
            break
        new = rows[seen:state.rows].tolist()
        if new:
            scheduler.take([_sample(row) for row in new])
    n = int(state.rows)
    return Flown(rows[:n], gains[:n], every * h, bool(state.lost))


def _fly_turn(vehicle: Vehicle, scheduler: Scheduler, fly_on: FlyOn, ticks: range, rows: np.ndarray,
              gains: np.ndarray) -> None:
    """Fly the steps of `ticks`, a controller period each (in one go once the gains are settled); write rows and
    gains."""
    state = vehicle.flight[0]
    target = scheduler.target(ticks.start * state.step)
    for start in ticks:
        state.kp, state.kd = scheduler.move(target, state.period)
        settled = scheduler.gains == target
        first = int(state.rows)
        fly_on(vehicle, (ticks.stop if settled else min(start + ticks.step, ticks.stop)) - start, rows)
        gains[first:state.rows] = scheduler.gains
        if settled or state.lost:
            return


def _sample(row: tuple[float, ...]) -> Sample:
    """Return a log row as the estimator's sample: what the sensors read, and the logged command."""
    t, _, beta_cmd, beta, theta, theta_dot = row[:6]
    return Sample(round(t, CLOCK_DIGITS), theta, theta_dot, beta, math.nan, beta_cmd)
