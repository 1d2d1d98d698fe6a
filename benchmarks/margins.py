"""Margins of flights with a servo that is not known: do the 95 % intervals hold the truth, and what does it cost?

    python benchmarks/margins.py [--flights 100] [--seed 0] [--windows 5 10] [--nominals ...] [--air calm wind]

`flight` suite, a6 and k1 within 20 % of the nominal's, servo frequency and damping ratio within 30 %, delay 0 to 30 ms,
all drawn uniformly, declared with sigmas 0.3, 0.3 and 0.02 s.  The truth is the frozen loop of the true vehicle at the
window's centre (tracked: at its end), whose margins `tests/test_flight_margins.py` holds against python-control.
Bound: that of the complete problem (`sim.bound`), window by window.  Lost vehicles are left out.
"""

import argparse
import dataclasses

import numpy as np
from flights import NOMINALS, in_air, nominal, run_jobs

import launchid
from sim.bound.flights import flight_bound
from sim.flight import fly_whole, parameters
from sim.nominal import Nominal
from sim.uncertainty.loops import loops, plants_of
from sim.uncertainty.margin_spread import NAMES, margin_table

SPREAD, SERVO_SPREAD, MOST_DELAY = 0.2, 0.3, 0.03
SIGMA = {"natural_frequency_sigma": 0.3, "damping_ratio_sigma": 0.3, "delay_sigma": 0.02}
LEAST, MOST, RATIO_MOST = 0.93, 0.975, 1.15


def drawn(believed: Nominal, seed: int) -> tuple[Nominal, float, float]:
    """The true vehicle's servo, and its a6 and k1 over the nominal's."""
    random = np.random.default_rng((919, seed))
    frequency, damping = 1.0 + random.uniform(-SERVO_SPREAD, SERVO_SPREAD, 2)
    a6, k1 = 1.0 + random.uniform(-SPREAD, SPREAD, 2)
    servo = believed.actuator
    assert servo is not None
    return dataclasses.replace(believed, actuator=dataclasses.replace(
        servo, natural_frequency=servo.natural_frequency * frequency, damping_ratio=servo.damping_ratio * damping,
        delay=float(random.uniform(0.0, MOST_DELAY)))), float(a6), float(k1)


def judged(name: str, air: str, window: float, seed: int) -> dict[str, np.ndarray] | None:
    """The judgement of one flight: whether the interval of each margin holds, by window and tracked, errors over the
    bound, and the servo's errors over their standard deviations.  None if it is lost."""
    believed = in_air(nominal(name), air)
    true, a6_factor, k1_factor = drawn(believed, seed)
    flight = fly_whole(true, seed, a6_factor=a6_factor, k1_factor=k1_factor)
    if flight.lost:
        return None
    columns = {each: getattr(flight, each) for each in ("t", "theta_ref", "beta_cmd", "beta", "theta", "theta_dot")}
    assert believed.actuator is not None and true.actuator is not None
    declared = dataclasses.replace(believed, actuator=dataclasses.replace(believed.actuator, **SIGMA))
    made = launchid.margins(columns, declared, window=window, tracked=True)
    servo = np.array([true.actuator.natural_frequency, true.actuator.damping_ratio, true.actuator.delay])
    unknown = dataclasses.replace(true, actuator=dataclasses.replace(true.actuator, **SIGMA))
    bound = flight_bound(unknown, window, seed, a6_factor=a6_factor, k1_factor=k1_factor)
    known = flight_bound(true, window, seed, a6_factor=a6_factor, k1_factor=k1_factor)
    rows: dict[str, list[list[float]]] = {"window": [], "tracked": [], "ratio": [], "cost": []}
    for k, each in enumerate(made.windows):
        for of, at in (("window", 0.5 * (each.t_start + each.t_end)), ("tracked", each.t_end)):
            judgement = getattr(each, of)
            a6, k1 = (float(x) for x in parameters(true, np.array(at), a6_factor, k1_factor))
            if judgement.spread is None:
                continue
            truth = margin_table(loops(plants_of(np.array([[a6, k1, *servo]])), believed.controller))[0]
            rows[of].append([float(interval.low <= x <= interval.high) for x, interval in zip(
                truth, (getattr(judgement.spread, margin) for margin in NAMES), strict=True)])
            if of == "window" and k < len(bound.a6):
                rows["ratio"].append([(judgement.known.mean[0] / a6 - 1) / bound.a6[k],
                                      (judgement.known.mean[1] / k1 - 1) / bound.k1[k]])
                rows["cost"].append([bound.a6[k] / known.a6[k], bound.k1[k] / known.k1[k]])
    error = (made.servo.mean - servo) / np.sqrt(np.diag(made.servo.covariance))
    return {of: np.array(x) for of, x in rows.items()} | {"servo": error[None]}


def cell(name: str, air: str, window: float, flights: int, first: int) -> None:
    """One line of the table."""
    made = [each for each in run_jobs(judged, [(name, air, window, first + k) for k in range(flights)]) if each]
    print(f"{name}, {air}, {window:g} s windows, {len(made)} flights")
    for of in ("window", "tracked"):
        rows = np.concatenate([each[of].reshape(-1, len(NAMES)) for each in made])
        covered = rows.mean(axis=0)
        missed = " MISSED" if ((covered < LEAST) | (covered > MOST)).any() else ""
        print(f"  {of:<8} {len(rows):5d}: " + ", ".join(f"{margin} {100 * share:.1f} %" for margin, share in
                                                         zip(NAMES, covered, strict=True)) + missed)
    servo = np.concatenate([each["servo"] for each in made])
    inside = (np.abs(servo) < 1.96).mean(axis=0)
    print("  servo within 1.96 std: " + ", ".join(f"{100 * share:.0f} %" for share in inside)
          + "; rms error over std: " + ", ".join(f"{x:.2f}" for x in np.sqrt((servo**2).mean(axis=0))))
    ratio, cost = (np.concatenate([each[of].reshape(-1, 2) for each in made]) for of in ("ratio", "cost"))
    rms = np.sqrt((ratio**2).mean(axis=0))
    print(f"  error over the bound of the complete problem: a6 {rms[0]:.2f}, k1 {rms[1]:.2f}"
          + (" MISSED" if (rms > RATIO_MOST).any() else "")
          + f"; bound over a known servo's, median: a6 {np.median(cost[:, 0]):.3f}, k1 {np.median(cost[:, 1]):.3f}")


def main() -> None:
    """All cells."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--windows", type=float, nargs="+", default=[5.0, 10.0])
    parser.add_argument("--nominals", nargs="+", default=list(NOMINALS))
    parser.add_argument("--air", nargs="+", default=["calm", "wind"])
    args = parser.parse_args()
    for name in args.nominals:
        for air in args.air:
            for window in args.windows:
                cell(name, air, window, args.flights, args.seed)


if __name__ == "__main__":
    main()
