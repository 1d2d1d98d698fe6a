"""Margins of flights: do their 95 % intervals hold the truth, do they warn, does the gate refuse what it must?

    python benchmarks/margins.py coverage|warnings|gate|another|clean|fitted|alone|gains|undeclared|peer|modes
                                 [--flights N] [--seed 0] [--nominal NAME] [--law NAME] [--vehicle NAME] [--moving]
                                 [--seen columns|others|half]

In the first three the servo is not known: it is declared with sigmas of 0.3, 0.3 and 0.02 s about the nominal's.

coverage: `flight` suite, a6 and k1 within 20 % of the nominal's, servo frequency and damping ratio within 30 %, delay 0
to 30 ms, all drawn uniformly.  The truth is the frozen loop of the true vehicle at the window's centre (tracked: at its
end), whose margins `test_flight_margins.py` holds against python-control.  Bound: that of the complete problem
(`launchid.bound`), window by window.  Lost vehicles are left out.

warnings: `constant`, 30 s.  Half of the flights have a servo whose lag leaves less than 20 degrees of phase margin
(frequency and delay drawn, within three of their declared standard deviations, until it does); the other half are the
coverage's vehicles, as far as they keep 30 degrees and 6 dB.  Named: `below` lists one of the first two windows of 5 s.
False: it lists any window of a vehicle that keeps what is required.

gate: the scenarios of `reconfiguration.py` with the true servo drawn as in coverage.  Every gain set that was put to
the gate is judged by the true vehicle of that moment: how many had less than 20 degrees, and how many of these flew.

another: the loop that flew is not the nominal's: CONTROLLERS, servos that CHANGE in flight, declared known and not
known, and servos that are otherwise wrong (WRONG).  A window is right if each margin is within three half-widths of its
interval of the true frozen loop's (the low gain margin as a factor), or if it is refused.

fitted: the controller is none that the nominal has: the laws of tests/any_law.py around three VEHICLES, in 10 s
windows, flown by an integration of its own; the nominal has the true vehicle and servo, and another controller. The
truth is python-control's. Flights whose reference moves; without --moving then those whose reference stands. +-: median
half-widths.
alone: the same without a nominal.  --seen others: the columns are of other sensors than the controller's; half: every
second row.

gains: `--scale` asks for other gains than flew, a factor of 0.7 to 1.4 on each; the truth is the loop with these gains,
as it would fly. undeclared: damping or slosh that the nominal does not have, `flight` suite; the truth is the loop with
it.

peer: margins out of the log alone beside the published method of a public chirp tool (betaflight-chirp-core 0.4.0, its
README and changelog): T = theta/theta_ref by Welch's cross spectra, Ms = max |1 - T|, the guaranteed phase margin
2 asin(1/(2 Ms)), the phase margin 180 degrees + arg T at the closed loop's 0 dB, +- half of what the phase turns from
one line to the next there. The reference is a sweep of 8 mrad, 0.1 to 3 Hz, or the guidance. RMS errors.

modes: `cr826_max_q`, first bending mode, two slosh masses and a notch that follows, 30 s, 10 s windows; a6 and k1
within the nominal's 10 %, modes drawn with the sigmas that it declares.  The truth is python-control's frozen loop of
the true vehicle (tests/control_loops.py), with the notch where the judged loop has it, on a dense grid.  Judged: the
margins of the rigid crossings, and of the bending mode the one that holds it.

clean: nothing is wrong; controller and log at 25 to 200 Hz, and logs faster and slower than the controller.  Lost: the
share of the windows that the estimator has numbers of and the tests of controller and servo refuse.
"""

import argparse
import dataclasses
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from flights import INTERVAL, Table, arguments, at_rate, in_air, nominal, run_jobs
from scipy.signal import coherence, csd, welch

import launchid
from launchid.bound.flights import flight_bound
from launchid.monte_carlo.campaign import draw_jobs
from launchid.robustness import reconfigure
from launchid.robustness.airframe import airframe_of
from launchid.robustness.blocks import plants_of
from launchid.robustness.flight_margins import declared_servo, servo_at
from launchid.robustness.flown import UNCHECKED, loop_that_flew
from launchid.robustness.loops import loops
from launchid.robustness.margin_spread import MARGIN_NAMES, margin_table
from launchid.robustness.montecarlo import SCENARIOS, factors
from sim.disturbance_draws import drawn_modes
from sim.effects import effect
from sim.flight import Flight, fly_whole, prepare
from sim.nominal import Nominal, constant_profile
from sim.plant import Factor, dispersion, parameters
from sim.sections import Controller, Section
from sim.vehicle.actuator import fastest_pole
from sim.vehicle.record import LOG_ROW
from sim.vehicle.step import advance

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
import control_loops
from any_law import GUIDANCE, LAWS, STILL, Vehicle, fly, pd, truth
from any_law import law as any_law_of

SPREAD, SERVO_SPREAD, MOST_DELAY = 0.2, 0.3, 0.03
SIGMA = {"natural_frequency_sigma": 0.3, "damping_ratio_sigma": 0.3, "delay_sigma": 0.02}
LOGGED = ("t", "theta_ref", "beta_cmd", "beta", "theta", "theta_dot")
AIRS, WINDOWS = ("calm", "wind"), (5.0, 10.0)  # s
LEAST, MOST, RATIO_MOST = 0.93, 0.975, 1.15


def drawn(believed: Nominal, seed: int) -> tuple[Nominal, float, float]:
    """Draw the true vehicle's servo; return the nominal with it, and the true a6 and k1 over the nominal's."""
    random = np.random.default_rng((919, seed))
    frequency, damping = 1.0 + random.uniform(-SERVO_SPREAD, SERVO_SPREAD, 2)
    a6, k1 = 1.0 + random.uniform(-SPREAD, SPREAD, 2)
    servo = believed.actuator
    return dataclasses.replace(believed, actuator=dataclasses.replace(
        servo, natural_frequency=servo.natural_frequency * frequency, damping_ratio=servo.damping_ratio * damping,
        delay=float(random.uniform(0.0, MOST_DELAY)))), float(a6), float(k1)


def declared_unknown(vehicle: Nominal) -> Nominal:
    """Return the vehicle with its servo declared uncertain, with SIGMA."""
    return dataclasses.replace(vehicle, actuator=dataclasses.replace(vehicle.actuator, **SIGMA))


def _columns(flight: Flight) -> dict[str, np.ndarray]:
    """Return the columns of a flight that are logged."""
    return {each: getattr(flight, each) for each in LOGGED}


def judged(name: str, air: str, window: float, seed: int) -> dict[str, np.ndarray] | None:
    """Judge one flight's margins; None if it is lost.  window, tracked (n, 6): whether each interval holds the truth;
    ratio (n, 2): errors of a6, k1 over the bound; cost: that bound over a known servo's; servo (1, 3): its errors over
    their std."""
    believed = in_air(nominal(name), air)
    true, a6_factor, k1_factor = drawn(believed, seed)
    flight = fly_whole(true, seed, a6_factor=a6_factor, k1_factor=k1_factor)
    if flight.lost:
        return None
    made = launchid.margins(_columns(flight), declared_unknown(believed), window=window, tracked=True)
    servo = np.array([true.actuator.natural_frequency, true.actuator.damping_ratio, true.actuator.delay])
    bound = flight_bound(declared_unknown(true), window, seed, a6_factor=a6_factor, k1_factor=k1_factor)
    known = flight_bound(true, window, seed, a6_factor=a6_factor, k1_factor=k1_factor)
    rows: dict[str, list[list[float]]] = {"window": [], "tracked": [], "ratio": [], "cost": []}
    for k, each in enumerate(made.windows):
        for of, at in (("window", 0.5 * (each.t_start + each.t_end)), ("tracked", each.t_end)):
            judgement = getattr(each, of)
            a6, k1 = _at(true, at, a6_factor, k1_factor)
            if judgement.spread is None:
                continue
            truth = margins_of_vehicle(true, a6, k1)
            rows[of].append([float(interval.low <= x <= interval.high) for x, interval in zip(
                truth, (getattr(judgement.spread, margin) for margin in MARGIN_NAMES), strict=True)])
            if of == "window" and k < len(bound.a6):
                rows["ratio"].append([(judgement.known.mean[0] / a6 - 1) / bound.a6[k],
                                      (judgement.known.mean[1] / k1 - 1) / bound.k1[k]])
                rows["cost"].append([bound.a6[k] / known.a6[k], bound.k1[k] / known.k1[k]])
    error = (made.servo.mean - servo) / np.sqrt(np.diag(made.servo.covariance))
    return {of: np.array(x) for of, x in rows.items()} | {"servo": error[None]}


def coverage(args: argparse.Namespace) -> None:
    """Print for each nominal, air and window length how often intervals hold the truth, and servo and bound."""
    for name in args.nominal:
        for air in AIRS:
            for window in WINDOWS:
                made = [each for each in run_jobs(judged, [(name, air, window, seed) for seed in args.seeds]) if each]
                print(f"{name}, {air}, {window:g} s windows, {len(made)} flights")
                of = {key: np.concatenate([each[key].reshape(-1, size) for each in made]) for key, size in (
                    ("window", 6), ("tracked", 6), ("servo", 3), ("ratio", 2), ("cost", 2))}
                table = Table("of 8", "windows 7d", *(f"{margin} 6.1%" for margin in MARGIN_NAMES))
                for what in ("window", "tracked"):
                    covered = of[what].mean(axis=0)
                    table.row(what, len(of[what]), *covered, good=((covered >= LEAST) & (covered <= MOST)).all())
                inside = (np.abs(of["servo"]) < INTERVAL).mean(axis=0)
                servo, ratio = (np.sqrt((of[key]**2).mean(axis=0)) for key in ("servo", "ratio"))
                cost, missed = np.median(of["cost"], axis=0), "MISSED" if (ratio > RATIO_MOST).any() else ""
                print(f"  servo within {INTERVAL} std: {inside.round(2)}, rms error over std {servo.round(2)}\n"
                      f"  a6, k1: rms error over the bound of the complete problem {ratio.round(2)} {missed}; bound "
                      f"over a known servo's, median {cost.round(3)}", flush=True)


LITTLE = 20.0         # degrees of phase margin
SHORT = 30.0          # s, a flight of `warnings`
SLOWEST = 0.25        # of the nominal's frequency: 2.5 standard deviations
NAMED_LEAST, FALSE_MOST, REFUSED_LEAST = 0.95, 0.01, 0.95


def margins_of_vehicle(vehicle: Nominal, a6: float, k1: float, gains: tuple[float, ...] = ()) -> np.ndarray:
    """Return the true margins (6,) of a6, k1 [1/s^2] behind a vehicle's servo; gains (kp, kd [s]) if others fly."""
    servo, controller = vehicle.actuator, vehicle.controller
    row = np.array([[a6, k1, servo.natural_frequency, servo.damping_ratio, servo.delay]])
    return np.asarray(margin_table(loops(plants_of(row), controller, *gains))[0])


def slow_servo(believed: Nominal, seed: int) -> tuple[Nominal, float, float]:
    """Draw a vehicle whose servo leaves less than LITTLE degrees but is stable; and a6, k1 over the nominal's."""
    _, a6, k1 = drawn(believed, seed)
    servo, random = believed.actuator, np.random.default_rng((920, seed))
    while True:
        late = dataclasses.replace(believed, actuator=dataclasses.replace(
            servo, natural_frequency=servo.natural_frequency * random.uniform(SLOWEST, 1.0),
            delay=float(random.uniform(0.0, 3.0 * SIGMA["delay_sigma"]))))
        if 0.0 < margins_of_vehicle(late, *_at(late, 0.0, a6, k1))[2] < LITTLE:
            return late, a6, k1


def _at(vehicle: Nominal, t: float, a6: Factor, k1: Factor) -> tuple[float, float]:
    """Return true a6, k1 [1/s^2] at t [s]."""
    true_a6, true_k1 = parameters(vehicle, np.array(t), a6, k1)
    return float(true_a6), float(true_k1)


def warned(is_slow: bool, seed: int) -> tuple[bool, bool, bool] | None:
    """Return whether a flight was named within two windows, whether in any, whether the vehicle keeps what is required;
    None if it is lost."""
    believed = nominal("constant")
    believed = dataclasses.replace(believed, simulation=dataclasses.replace(believed.simulation, duration=SHORT))
    true, a6, k1 = (slow_servo if is_slow else drawn)(believed, seed)
    flight = fly_whole(true, seed, a6_factor=a6, k1_factor=k1)
    if flight.lost:
        return None
    made = launchid.margins(_columns(flight), declared_unknown(believed))
    below = {each["t_start"] for each in made.report["below"]}
    first = {each.t_start for each in made.windows[:2]}
    low, high, phase, *_ = margins_of_vehicle(true, *_at(true, 0.0, a6, k1))
    required = believed.margins
    return bool(below & first), bool(below), bool(
        -low >= required.gain_db and high >= required.gain_db and phase >= required.phase_deg)


def warnings(args: argparse.Namespace) -> None:
    """Print how often vehicles with little phase margin are named, and sound ones falsely."""
    slow, sound = ([each for each in run_jobs(warned, [(kind, seed) for seed in args.seeds]) if each]
                   for kind in (True, False))
    keeps = [each for each in sound if each[2]]
    named, false = np.mean([each[0] for each in slow]), np.mean([each[1] for each in keeps])
    table = Table("vehicle 32", "flights 7d", "named 6.1%")
    table.row(f"less than {LITTLE:g} degrees, two windows", len(slow), named, good=named >= NAMED_LEAST)
    table.row("what is required is kept", len(keeps), false, good=false <= FALSE_MOST)


def gated(name: str, scenario: str, seed: int) -> tuple[int, int, int, int, int]:
    """Fly once; return how many gain sets were put to the gate, had little phase margin, of these were adopted, and of
    those beat the legacy gains'; whether it was lost."""
    believed = nominal(name)
    true, _, _ = drawn(believed, seed)
    job = draw_jobs(name, scenario, [seed])[0]
    a6, k1 = factors(believed, job)
    asked: list[tuple[float, tuple[float, float], bool]] = []

    class Watched(reconfigure.Gate):
        """A gate that notes what it was asked."""

        def judge(self, t: float, *given: Any) -> reconfigure.Decision:
            decision = super().judge(t, *given)
            asked.append((t, given[1], decision.adopted))
            return decision

    with mock.patch.object(reconfigure, "Gate", Watched):
        flown = reconfigure.fly_reconfigured(true, seed, a6, k1, declared_unknown(believed))
    little = [(t, gains, adopted) for t, gains, adopted in asked
              if margins_of_vehicle(true, *_at(true, t, a6, k1), gains)[2] < LITTLE]
    flew = [(t, gains) for t, gains, adopted in little if adopted]
    better = sum(margins_of_vehicle(true, *_at(true, t, a6, k1))[2] < margins_of_vehicle(
        true, *_at(true, t, a6, k1), gains)[2] for t, gains in flew)
    return len(asked), len(little), len(flew), int(better), int(flown.lost)


def gate(args: argparse.Namespace) -> None:
    """Print for each nominal and scenario how many gain sets were put to the gate, were unsafe, and were flown."""
    table = Table("nominal 16", "scenario 8", "flights 7d", "lost 5d", "asked 7d", "little 7d", "flew 5d",
                  "legacy less 11d")
    for name in args.nominal:
        for scenario in SCENARIOS:
            rows = np.array(run_jobs(gated, [(name, scenario, seed) for seed in args.seeds]))
            asked, little, flew, better, lost = rows.sum(axis=0)
            table.row(name, scenario, len(rows), lost, asked, little, flew, better,
                      good=flew - better <= (1.0 - REFUSED_LEAST) * little)


# ---- the loop that flew


def _gains(kp: float = 1.0, kd: float = 1.0, tau: float = 1.0, period: float = 1.0) -> Any:
    return lambda c: dataclasses.replace(c, kp=kp * c.kp, kd=kd * c.kd, period=period * c.period,
                                         derivative_time_constant=tau * c.derivative_time_constant)


def _averaged(c: Controller) -> Controller:
    """Return the controller with a filter that takes the mean of two commands: half a period later, and no more."""
    return dataclasses.replace(c, filters=(Section((0.5, 0.5, 0.0), (1.0, 0.0, 0.0)),))


CONTROLLERS = {"kp * 0.8": _gains(kp=0.8), "kp * 1.2": _gains(kp=1.2), "kp * 0.95": _gains(kp=0.95),
               "kd * 0.6": _gains(kd=0.6), "kd * 1.3": _gains(kd=1.3), "kd * 1.01": _gains(kd=1.01),
               "kp * 2, kd * 0.7": _gains(kp=2.0, kd=0.7), "tau * 2": _gains(tau=2.0), "tau * 0.9": _gains(tau=0.9),
               "10 ms late": _gains(), "period * 2": _gains(period=2.0), "filter": _averaged}
CHANGE_AT = 33.0   # s: no window's edge
CHANGE = {"delay 10 to 30 ms": (1.0, 1.0, 0.01, 0.02), "delay + 5 ms": (1.0, 1.0, 0.0, 0.005),
          "delay + 2 ms": (1.0, 1.0, 0.0, 0.002), "frequency - 30 %": (0.7, 1.0, 0.0, 0.0),
          "frequency - 10 %": (0.9, 1.0, 0.0, 0.0), "damping - 40 %": (1.0, 0.6, 0.0, 0.0)}  # and delay before, added
WRONG = {"damping + 20 %": 0.0, "play 1 mrad": 0.001, "play 0.3 mrad": 0.0003, "row late": 0.0}
RIGHT, LOST_MOST = 3.0, 0.02
RATES = ((25.0, 25.0), (50.0, 50.0), (100.0, 100.0), (200.0, 200.0), (50.0, 200.0), (100.0, 50.0))  # controller, log


def flown(believed: Nominal, kind: str, name: str, seed: int) -> tuple[dict[str, np.ndarray], Nominal, Any]:
    """Return a log of another loop, the nominal to ask its margins with, and a function t [s] -> true vehicle (None:
    its margins are not known)."""
    servo, controller = believed.actuator, believed.controller
    if kind == "controller":
        true = dataclasses.replace(believed, controller=CONTROLLERS[name](controller))
        late = 0.01 if name == "10 ms late" else 0.0
        effects = [effect("controller_mismatch", delay=late)] if late else []
        at = dataclasses.replace(true, actuator=dataclasses.replace(servo, delay=servo.delay + late))
        log = _columns(fly_whole(true, seed, effects=effects, period=believed.sensors.period))
        return log, believed, lambda t: at
    if kind == "wrong":
        true = dataclasses.replace(believed, actuator=dataclasses.replace(
            servo, damping_ratio=servo.damping_ratio * (1.2 if name == "damping + 20 %" else 1.0)))
        effects = [effect("actuator_backlash", half_width=WRONG[name])] if WRONG[name] else []
        log = _columns(fly_whole(true, seed, effects=effects))
        if name == "row late":
            log["beta_cmd"] = np.concatenate([log["beta_cmd"][1:], log["beta_cmd"][-1:]])
        return log, believed, lambda t: None if name == "row late" else true
    frequency, damping, delay, more = CHANGE[name]
    before = dataclasses.replace(believed, actuator=dataclasses.replace(servo, delay=servo.delay + delay))
    after = dataclasses.replace(believed, actuator=dataclasses.replace(
        servo, natural_frequency=servo.natural_frequency * frequency, damping_ratio=servo.damping_ratio * damping,
        delay=servo.delay + delay + more))
    vehicle, steps = prepare(before, seed, "flight", None, 1.0, 1.0)
    state, rows = vehicle.flight[0], np.empty(steps, LOG_ROW)
    first = round(CHANGE_AT / state.step)
    advance(vehicle, first, rows)
    new = after.actuator
    state.frequency, state.damping, state.delay = new.natural_frequency, new.damping_ratio, new.delay
    state.pole = fastest_pole(state.frequency, state.damping)
    advance(vehicle, steps - first, rows)
    columns = {name: rows[name][:int(state.rows)].copy() for name in LOGGED}
    return columns, (declared_unknown(before) if kind == "unknown" else before), \
        lambda t: before if t < CHANGE_AT else after


def right(name: str, kind: str, regime: str, seed: int) -> tuple[int, int, float, str]:
    """Ask the margins of a flight of another loop; return the number of windows, of those refused, the largest error of
    the others in half-widths, and where it is."""
    believed = nominal(name)
    log, asked, vehicle_at = flown(believed, kind, regime, seed)
    made = launchid.margins(log, asked)
    worst, where = 0.0, ""
    for each in made.windows:
        if each.window.spread is None:
            continue
        middle = 0.5 * (each.t_start + each.t_end)
        vehicle = vehicle_at(middle)
        truth = np.full(6, np.nan) if vehicle is None else margins_of_vehicle(vehicle, *_at(vehicle, middle, 1.0, 1.0))
        for true, margin in zip(truth, MARGIN_NAMES, strict=True):
            interval = getattr(each.window.spread, margin)
            x, value, low, high = true, interval.value, interval.low, interval.high
            if margin == "gain_low_db":   # as a factor: of a plant that is hardly unstable dB have no end
                x, value, low, high = (10.0 ** (db / 20.0) for db in (x, value, low, high))
            half = high - value if x > value else value - low
            error = abs(x - value) / max(half, 1e-9) if not np.isnan(x) else np.inf
            if error > worst:
                worst, where = error, f"{margin} in {each.t_start:g}..{each.t_end:g} s"
    return len(made.windows), sum(not each.window.valid for each in made.windows), worst, where


def another(args: argparse.Namespace) -> None:
    """Print for each loop that is not the nominal's how many windows are refused, and the largest error of the rest."""
    regimes = [*(("controller", each) for each in CONTROLLERS), *(("known", each) for each in CHANGE),
               *(("unknown", each) for each in CHANGE), *(("wrong", each) for each in WRONG)]
    table = Table("nominal 16", "what 10", "regime 18", "windows 7d", "refused 7d", "largest error, half-widths 6.2f",
                  "where 32")
    for name in args.nominal:
        for kind, regime in regimes:
            rows = run_jobs(right, [(name, kind, regime, seed) for seed in args.seeds])
            worst = max(rows, key=lambda each: each[2])
            table.row(name, kind, regime, sum(each[0] for each in rows), sum(each[1] for each in rows), *worst[2:],
                      good=worst[2] <= RIGHT)


def kept(name: str, air: str, rate: float, of_log: float, seed: int) -> tuple[int, int, int]:
    """Fly with nothing wrong; return how many windows have numbers, how many of them the tests refuse, how many cannot
    be tested; 0 of a lost vehicle."""
    believed = in_air(at_rate(nominal(name), rate), air)
    flight = fly_whole(believed, seed, period=1.0 / of_log)
    if flight.lost:
        return 0, 0, 0
    made = launchid.identify(_columns(flight), believed, window=5.0)
    servos = [servo_at(declared_servo(believed), e) for e in made.estimates]
    tested = loop_that_flew(made.log, believed, made.estimates, servos)
    valid = [k for k, e in enumerate(made.estimates) if e.valid]
    not_made = sum(tested.refused.get(k) == UNCHECKED for k in valid)
    return len(valid), sum(k in tested.refused for k in valid) - not_made, not_made


def clean(args: argparse.Namespace) -> None:
    """Print for each nominal, air and rates how many windows of flights without fault the tests refuse."""
    total = np.zeros(3, int)
    table = Table("nominal 16", "air 5", "controller [Hz] 4g", "log [Hz] 4g", "windows 7d", "refused 7d",
                  "cannot be tested 4d")
    for name in args.nominal:
        for air in AIRS:
            for rate, of_log in RATES:
                rows = np.sum(run_jobs(kept, [(name, air, rate, of_log, seed) for seed in args.seeds]), axis=0)
                total += rows
                table.row(name, air, rate, of_log, *rows)
    lost = total[1] / total[0]
    print(f"{lost:.2%} of {total[0]} windows lost" + (" MISSED" if lost > LOST_MOST else ""))


# ---- any controller

VEHICLES = {"paper": Vehicle(), "light": Vehicle(0.8, -4.0, 70.0, 0.6, 0.004),
            "agile": Vehicle(3.5, -12.0, 40.0, 0.9, 0.012)}
GAIN_SCALE = {"paper": 1.0, "light": 1.6, "agile": 0.8}   # of the laws' commands: the loops are alike
LONG, FEW = 10.0, 0.005    # s of a window; of windows that may be beyond three half-widths
HELD_LEAST, HELD_MOST, REFUSED_MOST = 0.90, 0.98, 0.10


def scaled(name: str, vehicle: str) -> Any:
    """Return a law of LAWS with the vehicle's factor on its commands."""
    law, factor = LAWS[name], GAIN_SCALE[vehicle]
    return law._replace(b=factor * law.b, c=factor * law.c, d=factor * law.d)


def believed_of(of: Vehicle, period: float) -> Nominal:
    """Return a nominal of the true vehicle and servo, with another controller of that period [s]."""
    believed = nominal("constant")
    return dataclasses.replace(
        believed, vehicle=constant_profile(of.a6, of.k1), controller=dataclasses.replace(
            believed.controller, period=period), actuator=dataclasses.replace(
            believed.actuator, natural_frequency=of.frequency, damping_ratio=of.damping, delay=of.delay))


def judged_law(name: str, vehicle: str, moves: bool, alone: bool, seen: str, seed: int) -> dict[str, np.ndarray]:
    """Ask the margins of a flight behind a law.  counts: windows, refused; inside, far (n, 6): whether each interval
    holds the truth, whether it is beyond three half-widths; half (n, 6).  seen: by the controller."""
    law, of = scaled(name, vehicle), VEHICLES[vehicle]
    draw = 1000 * seed + 10 * list(LAWS).index(name) + list(VEHICLES).index(vehicle)   # no two with the same noise
    columns = fly(law, of, draw, guidance=GUIDANCE if moves else STILL, copies=seen == "others")
    if seen == "half":
        columns = {key: x[::2] for key, x in columns.items()}
    made = launchid.margins(columns, None if alone else believed_of(of, law.T), window=LONG, controller="log")
    right, inside, far, halves = truth(law, of, 20_000), [], [], []
    for each in made.windows:
        spread = each.window.spread
        if spread is None:
            continue
        intervals = [getattr(spread, margin) for margin in MARGIN_NAMES]
        half = [max(i.high - i.value, i.value - i.low) for i in intervals]
        inside.append([i.low - 2e-4 <= x <= i.high + 2e-4 for x, i in zip(right, intervals, strict=True)])
        far.append([abs(x - i.value) > 3.0 * max(h, 1e-3) for x, i, h in zip(right, intervals, half, strict=True)])
        halves.append(half)
    return {"counts": np.array([len(made.windows), len(made.windows) - len(inside)]),
            "inside": np.array(inside).reshape(-1, 6), "far": np.array(far).reshape(-1, 6),
            "half": np.array(halves).reshape(-1, 6)}


def any_law(args: argparse.Namespace, alone: bool) -> None:
    """Print for each reference and law how often intervals hold the truth, how wide they are, what is refused."""
    for moves in (True, False)[:1 if args.moving else 2]:
        print("the reference moves" if moves else "the reference stands")
        table = Table("law 14", "windows 7d", "refused 6.1%", *(f"{margin} 6.1%" for margin in MARGIN_NAMES),
                      "far 6.2%", *(f"+-{each} 7.3g" for each in ("dB", "dB", "deg", "ms", "1", "1")))
        jobs = [(name, vehicle, moves, alone, args.seen, seed) for name in args.law for vehicle in args.vehicle
                for seed in args.seeds]
        every = run_jobs(judged_law, jobs)
        for name in args.law:
            _law_row(table, name, [each for each, job in zip(every, jobs, strict=True) if job[0] == name], False)
        _law_row(table, "every law", every, True)


def _law_row(table: Table, name: str, made: list[dict[str, np.ndarray]], is_judged: bool) -> None:
    counts = np.sum([each["counts"] for each in made], axis=0)
    inside, far, half = (np.concatenate([each[key] for each in made]) for key in ("inside", "far", "half"))
    held = inside.mean(axis=0) if len(inside) else np.full(6, np.nan)
    away = float(np.mean(far.any(axis=1))) if len(far) else 0.0
    good = not is_judged or (bool(np.all((held >= HELD_LEAST) & (held <= HELD_MOST))) and away <= FEW
                             and counts[1] <= REFUSED_MOST * counts[0])
    table.row(name, counts[0], counts[1] / counts[0], *held, away, *(np.median(half, axis=0) if len(half) else held),
              good=good)


def fitted(args: argparse.Namespace) -> None:
    """Run `any_law` with the vehicle's nominal."""
    any_law(args, False)


def out_of_log(args: argparse.Namespace) -> None:
    """Run `any_law` without a nominal."""
    any_law(args, True)


SCALED = {"pd": (1.2, 0.5, 0.05), "pd hot": (3.0, 1.1, 0.03), "pd soft": (0.7, 0.35, 0.1)}   # kp, kd, time constant
LEAST_FACTOR, MOST_FACTOR = 0.7, 1.4


def rescaled(name: str, vehicle: str, seed: int) -> np.ndarray:
    """Ask the margins of other gains than flew; return whether each interval holds the truth (n, 6)."""
    law, of = scaled(name, vehicle), VEHICLES[vehicle]
    draw = 1000 * seed + 10 * list(SCALED).index(name) + list(VEHICLES).index(vehicle)
    f, g = np.random.default_rng((921, draw)).uniform(LEAST_FACTOR, MOST_FACTOR, 2)
    kp, kd, tau = SCALED[name]
    den, top = pd(f * kp, g * kd, tau)
    right = truth(any_law_of(den, GAIN_SCALE[vehicle] * top), of, 20_000)
    made = launchid.margins(fly(law, of, draw), believed_of(of, law.T), window=LONG, controller="log",
                            scale=f"kp={f},kd={g}")
    inside = []
    for spread in (each.window.spread for each in made.windows):
        if spread is not None:
            inside.append([i.low - 2e-4 <= x <= i.high + 2e-4
                           for x, i in zip(right, (getattr(spread, name) for name in MARGIN_NAMES), strict=True)])
    return np.array(inside).reshape(-1, 6)


def gains(args: argparse.Namespace) -> None:
    """Print how often the intervals of gains that did not fly hold the margins that they would have."""
    table = Table("law 10", "windows 7d", *(f"{margin} 6.1%" for margin in MARGIN_NAMES))
    jobs = [(name, vehicle, seed) for name in SCALED for vehicle in args.vehicle for seed in args.seeds]
    made = run_jobs(rescaled, jobs)
    for name in SCALED:
        inside = np.concatenate([each for each, job in zip(made, jobs, strict=True) if job[0] == name])
        table.row(name, len(inside), *inside.mean(axis=0))
    inside = np.concatenate(made)
    held = inside.mean(axis=0)
    table.row("every law", len(inside), *held, good=bool(np.all((held >= HELD_LEAST) & (held <= HELD_MOST))))


UNDECLARED = {"damping 0": ("aero_damping", {"coefficient": 0.0}),
              "damping 0.1": ("aero_damping", {"coefficient": 0.1}),
              "damping 0.3": ("aero_damping", {"coefficient": 0.3}),
              "slosh 2 %": ("slosh", {"coupling": 0.02, "frequency": 4.0}),
              "slosh 5 %": ("slosh", {"coupling": 0.05, "frequency": 4.0})}


def hidden(name: str, kind: str, seed: int) -> tuple[int, np.ndarray, np.ndarray, np.ndarray]:
    """Ask the margins of a flight with what the nominal does not have; return the windows, and of those with margins
    whether each interval holds the truth, and is beyond three half-widths, and its half-width (n, 6)."""
    believed = nominal(name)
    effects = [effect(UNDECLARED[kind][0], **UNDECLARED[kind][1])]
    true = dataclasses.replace(believed, effects=(*believed.effects, *effects))
    flight = fly_whole(true, seed)
    if flight.lost:
        return 0, np.zeros((0, 6)), np.zeros((0, 6)), np.zeros((0, 6))
    made = launchid.margins(_columns(flight), believed)
    inside, far, half = [], [], []
    for each in made.windows:
        if each.window.spread is None:
            continue
        middle = 0.5 * (each.t_start + each.t_end)
        airframe, servo = airframe_of(true, middle), true.actuator
        row = [*_at(true, middle, 1.0, 1.0), servo.natural_frequency, servo.damping_ratio, servo.delay,
               airframe.damping, *(x for mode in airframe.modes for x in (mode.frequency, mode.size))]
        right = margin_table(loops(plants_of(np.array([row]), False, airframe.modes), believed.controller))[0]
        intervals = [getattr(each.window.spread, margin) for margin in MARGIN_NAMES]
        inside.append([i.low <= x <= i.high for x, i in zip(right, intervals, strict=True)])
        far.append([abs(x - i.value) > 3.0 * max(i.high - i.value, i.value - i.low)
                    for x, i in zip(right, intervals, strict=True)])
        half.append([0.5 * (i.high - i.low) for i in intervals])
    return len(made.windows), *(np.array(each).reshape(-1, 6) for each in (inside, far, half))


def undeclared(args: argparse.Namespace) -> None:
    """Print for each nominal and what it does not have how many windows have margins, and how often they hold."""
    table = Table("nominal 16", "what 12", "windows 7d", "refused 6.1%", *(f"{margin} 6.1%" for margin in MARGIN_NAMES),
                  "far 6.2%", *(f"+-{each} 7.3g" for each in ("dB", "dB", "deg", "ms", "1", "1")))
    for name in args.nominal:
        for kind in UNDECLARED:
            made = run_jobs(hidden, [(name, kind, seed) for seed in args.seeds])
            count = sum(each[0] for each in made)
            inside, far, half = (np.concatenate([each[k] for each in made]) for k in (1, 2, 3))
            held = inside.mean(axis=0) if len(inside) else np.full(6, np.nan)
            table.row(name, kind, count, 1.0 - len(inside) / max(count, 1), *held,
                      float(np.mean(far.any(axis=1))) if len(far) else 0.0,
                      *(np.median(half, axis=0) if len(half) else held),
                      good=not len(inside) or bool(np.all(held >= HELD_LEAST)))


SWEEP_SIZE, SWEEP_FROM, SWEEP_TIMES, SWEEP_LINE = 0.008, 0.1, 30.0, 10.0   # rad, Hz, last frequency over first, s
SURE = 0.6    # coherence


def sweep() -> tuple[np.ndarray, np.ndarray]:
    """Return times [s] and a reference [rad] that sweeps through frequencies exponentially."""
    t = np.arange(7000) * 0.01
    rate = np.log(SWEEP_TIMES) / t[-1]
    return t, SWEEP_SIZE * np.sin(2.0 * np.pi * SWEEP_FROM / rate * (np.exp(rate * t) - 1.0))


def chirp_method(columns: dict[str, np.ndarray]) -> np.ndarray:
    """Return phase margin [deg], its half-width, the guaranteed one, and Ms as the chirp tool describes them."""
    period = columns["t"][1]
    rows = round(SWEEP_LINE / period)
    frequency, power = welch(columns["theta_ref"], 1.0 / period, nperseg=rows)
    cross = csd(columns["theta_ref"], columns["theta"], 1.0 / period, nperseg=rows)[1]
    sure = (coherence(columns["theta_ref"], columns["theta"], 1.0 / period, nperseg=rows)[1] > SURE) & (frequency > 0.0)
    closed = (cross / power)[sure]
    if len(closed) < 3:
        return np.full(4, np.nan)
    ms = float(np.abs(1.0 - closed).max())
    guaranteed = np.degrees(2.0 * np.arcsin(min(1.0 / (2.0 * ms), 1.0)))
    falls = np.flatnonzero((np.abs(closed[:-1]) >= 1.0) & (np.abs(closed[1:]) < 1.0))
    if not len(falls):
        return np.array([np.nan, np.nan, guaranteed, ms])
    k = int(falls[-1])
    turned = abs(float(np.angle(closed[k + 1] / closed[k], deg=True)))
    return np.array([180.0 + float(np.angle(closed[k], deg=True)), 0.5 * turned, guaranteed, ms])


def beside_peer(name: str, is_sweep: bool, seed: int) -> np.ndarray:
    """Return errors of phase and Ms by the chirp tool (phase, guaranteed, Ms), whether its interval holds, and by the
    log alone (phase, Ms), whether its interval holds: (7,)."""
    law = LAWS[name]
    columns = fly(law, VEHICLES["paper"], seed, guidance=sweep() if is_sweep else GUIDANCE)
    right = truth(law, VEHICLES["paper"], 20_000)
    theirs = chirp_method(columns)
    made = launchid.margins(columns, window="all").windows[0].window.spread
    own = (np.nan,) * 3 if made is None else (
        made.phase_deg.value - right[2], made.ms - 1.0 / right[4],
        float(made.phase_deg.low <= right[2] <= made.phase_deg.high))
    return np.array([theirs[0] - right[2], theirs[2] - right[2], theirs[3] - 1.0 / right[4],
                     abs(theirs[0] - right[2]) <= theirs[1], *own])


def peer(args: argparse.Namespace) -> None:
    """Print errors of the log alone and of the chirp tool's method on the same flights."""
    table = Table("reference 9", "law 12", "flights 7d", "chirp: deg 7.2f", "guaranteed 7.2f", "Ms 7.3f", "holds 6.1%",
                  "own: deg 7.2f", "Ms 7.3f", "holds 6.1%")
    for is_sweep in (True, False):
        for name in ("pd", "pd hot", "pd gyro", "pid", "pd low-pass", "cascade"):
            made = np.array(run_jobs(beside_peer, [(name, is_sweep, seed) for seed in args.seeds]))
            rms, held = np.sqrt(np.nanmean(made**2, axis=0)), np.nanmean(made, axis=0)
            table.row("sweep" if is_sweep else "guidance", name, len(made), *rms[:3], held[3], *rms[4:6], held[6])


# ---- loops with modes


FLEXIBLE, MODES_SECONDS, MODES_WINDOW = "cr826_max_q", 30.0, 10.0
TOLD = ("gain_low_db", "gain_high_db", "phase_deg", "bending1")


def true_margins(vehicle: Nominal, a6: float, k1: float) -> tuple[float, float, float, float, float]:
    """Return the rigid low and high gain margin [dB] and phase margin [deg] of a frozen loop, and of its bending mode
    by how much its peak is below 1 [dB] and its phase margin [deg], by python-control."""
    w = vehicle.bending[0].frequency.value[0]
    poles = [each.frequency.value[0] * np.sqrt(1.0 + each.coupling.value[0]) for each in vehicle.slosh]
    top = np.pi / vehicle.controller.period
    omega = np.unique(np.concatenate([np.geomspace(0.02, 0.999 * top, 4000), w * np.linspace(0.75, 1.25, 4000),
                                      *(pole * np.linspace(0.9, 1.1, 1000) for pole in poles)]))
    gain = control_loops.loop_gain(vehicle, a6, k1, omega)

    def crossed(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where x changes sign: omega and L there."""
        at = np.flatnonzero((x[1:] > 0.0) != (x[:-1] > 0.0))
        part = x[at] / (x[at] - x[at + 1])
        return omega[at] + part * (omega[at + 1] - omega[at]), gain[at] + part * (gain[at + 1] - gain[at])

    def is_bending(at: np.ndarray) -> np.ndarray:
        return np.abs(np.log(at / w)) < np.log(1.25)

    def is_mode(at: np.ndarray) -> np.ndarray:
        return is_bending(at) | np.any([np.abs(np.log(at / pole)) < np.log(1.05) for pole in poles], axis=0)

    on, on_gain = crossed(np.abs(gain) - 1.0)
    axis, axis_gain = crossed(gain.imag)
    phase = np.degrees(np.abs(np.angle(-on_gain)))
    kept = (axis_gain.real < 0.0) & ~is_mode(axis)
    factor = np.append(-1.0 / axis_gain.real[kept], -1.0 / gain[0].real)   # and where the nozzle stands
    peak = np.abs(gain[np.abs(np.log(omega / w)) < np.log(1.05)]).max()
    return (20.0 * np.log10(factor[factor < 1.0].max()), 20.0 * np.log10(factor[factor > 1.0].min(initial=np.inf)),
            phase[~is_mode(on)].min(initial=np.inf), -20.0 * np.log10(peak), phase[is_bending(on)].min(initial=np.inf))


def judged_modes(seed: int) -> list[tuple[list[bool], list[float]]] | None:
    """Return for each window whether the intervals of TOLD hold the truth, and their half-widths; None: lost."""
    believed = nominal(FLEXIBLE)
    believed = dataclasses.replace(believed, simulation=dataclasses.replace(believed.simulation,
                                                                            duration=MODES_SECONDS))
    true = drawn_modes(believed, seed)
    delta = np.random.default_rng((932, seed)).uniform(-1.0, 1.0, 2).tolist()
    factors = dispersion(believed, *delta)
    flight = fly_whole(true, seed, a6_factor=factors[0], k1_factor=factors[1], believed=believed)
    if flight.lost:
        return None
    rows = []
    for each in launchid.margins(_columns(flight), believed, window=MODES_WINDOW).windows:
        spread = each.window.spread
        if spread is None:
            continue
        middle = 0.5 * (each.t_start + each.t_end)
        low, high, phase, peak, phase_of = true_margins(
            dataclasses.replace(true, controller=each.window.controller.controller), *_at(true, middle, *factors))
        mode = next(of for of in spread.modes if of.name == "bending1")
        held, truth = (mode.gain_db, peak) if mode.is_gain_stabilised else (mode.phase_deg, phase_of)
        intervals = [*spread.rigid, held]
        rows.append(([of.low <= x <= of.high for of, x in zip(intervals, (low, high, phase, truth), strict=True)],
                     [0.5 * (of.high - of.low) for of in intervals]))
    return rows


def modes(args: argparse.Namespace) -> None:
    """Print how often the intervals of the rigid margins and of the bending mode's hold python-control's."""
    made = [each for each in run_jobs(judged_modes, [(seed,) for seed in args.seeds]) if each]
    rows = [row for each in made for row in each]
    inside, width = np.array([row[0] for row in rows]), np.array([row[1] for row in rows])
    table = Table("margin 14", "windows 7d", "held 6.1%", "half-width 10.2f")
    for k, name in enumerate(TOLD):
        share = float(inside[:, k].mean())
        table.row(name, len(rows), share, float(np.median(width[:, k])), good=0.90 <= share <= 0.98)




PARTS: dict[str, tuple[Callable[[argparse.Namespace], None], int]] = {
    "coverage": (coverage, 100), "warnings": (warnings, 200), "gate": (gate, 100), "another": (another, 4),
    "clean": (clean, 10), "fitted": (fitted, 2), "alone": (out_of_log, 1), "gains": (gains, 4),
    "undeclared": (undeclared, 3), "peer": (peer, 3),
    "modes": (modes, 40)}  # and their flights, if not said


def main() -> None:
    """Run the part that is asked for."""
    args = arguments(__doc__, PARTS, flights=0, seed=0, law=list(LAWS), vehicle=list(VEHICLES),
                     moving=False, seen=("columns", "others", "half"))
    part, flights = PARTS[args.part]
    args.seeds = range(args.seed, args.seed + (args.flights or flights))
    part(args)


if __name__ == "__main__":
    main()
