"""Columns slower than their log, and sensors at their end stops: flights of a known truth, written here from scratch.

The plant is theta_ddot = 2 theta - 6 u under a held input u, whose step is exact; the loop closes over noisy sensors.
"""

import functools
import math

import numpy as np
import pytest

from launchid.commands.identify import Identification, identify
from launchid.log.log import log_of
from launchid.log.rates import HELD_WORD, INTERPOLATED, OWN, rate_of
from launchid.log.stops import end_stops

A6, K1 = 2.0, -6.0
ROW = 0.004            # s, 250 Hz
MOST = 4.0             # standard deviations
SEED = 0


@functools.cache
def flown(seed: int, hold: float = ROW, seconds: float = 8.0, row: float = ROW,
          noise: float = 1.0, limit: float = 0.2) -> dict[str, np.ndarray]:
    """A flight whose input is held for `hold` [s] and within a limit [rad], its rows `row` [s] apart, with so many
    times the sensors' noise."""
    rng, w = np.random.default_rng(seed), math.sqrt(A6)
    c, s = math.cosh(w * row), math.sinh(w * row)
    frequency, phase = np.linspace(0.5, 12.0, 8), rng.uniform(0.0, 2.0 * np.pi, 8)
    theta = rate = u = 0.0
    rows = []
    for k in range(round(seconds / row)):
        seen = theta + noise * 2e-4 * rng.normal(), rate + noise * 2e-3 * rng.normal()
        if k % round(hold / row) == 0:
            test = 0.03 * np.sum(np.sin(frequency * k * row + phase)) / math.sqrt(8.0)
            u = float(np.clip(1.5 * seen[0] + 0.8 * seen[1] + test, -limit, limit))
        rows.append((k * row, *seen, u))
        steady = -K1 * u / A6   # theta at which the input balances
        theta, rate = steady + (theta - steady) * c + rate * s / w, (theta - steady) * w * s + rate * c
    return dict(zip(("t", "theta", "theta_dot", "beta"), np.array(rows).T, strict=True))


def slower(x: np.ndarray, every: int, kind: str) -> np.ndarray:
    """A column as a logger or a resampling writes it whose channel has one value in so many rows."""
    at = np.arange(len(x))
    return x[at // every * every] if kind == HELD_WORD else np.interp(at, at[::every], x[::every])


def asked(columns: dict[str, np.ndarray], window: float | str = "all", **choices) -> tuple[Identification, str]:
    made = identify(log_of(columns), window=window, **choices)
    return made, " ".join(made.warnings)


def off(made: Identification) -> list[float]:
    """The errors of each number of the valid windows, in its standard deviations."""
    return [abs(w[name] - true) / w[f"{name}_std"] for w in made.report["windows"] if w["valid"]
            for name, true in (("a6", A6), ("k1", K1))]


# ---- slower columns


def test_all_commands():
    made, said = asked(flown(SEED))
    window, = made.report["windows"]
    assert window["status"] == "OK" and max(off(made)) < 3.0 and window["k1_std"] < 0.03
    assert "Hz" not in said


@pytest.mark.parametrize("every", [25, 2])
def test_a_command_between_whose_values_lines_were_drawn_gives_no_number(every):
    flight = flown(SEED)
    for window in ("all", 2.0):
        made, said = asked(flight | {"beta": slower(flight["beta"], every, INTERPOLATED)}, window)
        assert f"beta is of {250.0 / every:.3g} Hz, interpolated: what it did between is not in the log" in said
        assert not any(w["valid"] for w in made.report["windows"])
        assert [lack["what"] for lack in made.report["lacks"]] == ["interpolated"]
        assert "log beta at every row, as it acts" in made.summary()


@pytest.mark.parametrize("every", [25, 5])
def test_a_command_of_a_slower_topic_is_said_and_its_numbers_know_of_it(every):
    flight = flown(SEED)
    for window in ("all", 2.0):
        made, said = asked(flight | {"beta": slower(flight["beta"], every, HELD_WORD)}, window)
        assert f"beta is of {250.0 / every:.3g} Hz, each value repeated" in said and "froze" not in said
        assert max(off(made), default=0.0) < MOST


@pytest.mark.parametrize("noise", [1.0, 0.02])
def test_an_input_that_was_held_over_rows_acted_up_to_the_next_one(noise):
    """Rows 10 ms apart, the input held for 20: the quadrature took each value for half a row too early, and what that
    left of theta_dot had k1 +- 0.010 at the lower noise."""
    made, said = asked(flown(SEED, hold=0.02, seconds=40.0, row=0.01, noise=noise), 10.0)
    assert "beta is of 50 Hz, each value repeated" in said and "beta is integrated as held" in said
    assert max(off(made)) < MOST and all(w["status"] == "OK" for w in made.report["windows"])
    assert all(w["k1_std"] < (0.03 if noise == 1.0 else 0.004) for w in made.report["windows"])


def test_a_held_input_beside_a_clipped_gyro():
    flight = flown(0, hold=0.02, seconds=40.0, row=0.01, noise=0.1)
    stop = 0.7 * np.max(np.abs(flight["theta_dot"]))
    made, said = asked(flight | {"theta_dot": np.clip(flight["theta_dot"], -stop, stop)}, 10.0)
    assert "held" in said and "end stop" in said and max(off(made), default=0.0) < MOST


def test_a_rate_of_a_slower_channel_is_said_too():
    flight = flown(0)
    made, said = asked(flight | {"theta_dot": slower(flight["theta_dot"], 5, INTERPOLATED)})
    assert "theta_dot is of 50 Hz, interpolated: what it did between is not in the log" in said
    assert max(off(made), default=0.0) < MOST


@pytest.mark.parametrize("written", [
    pytest.param(lambda x: x, id="to the bit"), pytest.param(lambda x: np.round(x, 7), id="7 decimals"),
    pytest.param(lambda x: x.astype(np.float32).astype(float), id="single precision"),
    pytest.param(lambda x: np.array([float(f"{v:.9g}") for v in x]), id="9 digits")])
@pytest.mark.parametrize("shape", ["noise", "walk", "smooth", "decay"])
def test_the_rate_of_a_column_is_that_of_its_own_values(shape, written):
    rng, t = np.random.default_rng(3), np.arange(0.0, 20.0, ROW)
    x = {"noise": 0.01 * rng.normal(size=len(t)), "walk": 1e-3 * np.cumsum(rng.normal(size=len(t))),
         "smooth": 0.1 * np.sin(3.0 * t) + 0.05 * np.sin(7.3 * t), "decay": np.exp(-0.2 * t) * np.sin(8.0 * t)}[shape]
    assert rate_of(t, written(x)).kind == OWN
    for every in (2, 3, 5, 25):
        found = rate_of(t, written(slower(x, every, INTERPOLATED)))
        assert found.kind == INTERPOLATED and found.period == pytest.approx(every * ROW, rel=0.01)
    stamps = np.arange(0.0, 20.0, 0.0333)   # no multiple of a row
    assert rate_of(t, written(np.interp(t, stamps, np.interp(stamps, t, x)))).kind == INTERPOLATED
    uneven = t + rng.uniform(-1e-3, 1e-3, len(t))
    assert rate_of(uneven, written(np.interp(uneven, t[::10], x[::10]))).kind == INTERPOLATED


@pytest.mark.parametrize("x", [
    pytest.param(lambda t: np.abs(t % 2.0 - 1.0), id="a triangle"),
    pytest.param(lambda t: np.clip(np.cumsum(2e-3 * np.sign(np.sin(3.0 * t) + 0.3 * np.sin(11.0 * t))), -0.2, 0.2),
                 id="a rate limit"),
    pytest.param(lambda t: np.round(0.1 * np.sin(2.0 * t), 3), id="a quantum"),
    pytest.param(lambda t: 0.01 * t, id="a ramp"), pytest.param(np.zeros_like, id="nothing"),
    pytest.param(lambda t: np.sin(5.0 * t), id="a sine"),
    pytest.param(lambda t: (1.0 + 0.3 * np.sin(t)) * np.sin(0.5 * np.pi * t / ROW),
                 id="an oscillation of four rows"),
    pytest.param(lambda t: t[:3], id="three rows"),
    pytest.param(lambda t: np.full(len(t), math.nan), id="not measured"),
    pytest.param(lambda t: np.where(np.arange(len(t)) % 7 == 3, 1e308, -1e308), id="beyond a double's range")])
def test_what_is_of_the_log_s_own_rate(x):
    t = np.arange(0.0, 20.0, ROW)
    assert rate_of(t[:len(x(t))], x(t)).kind == OWN


# ---- end stops


@pytest.mark.parametrize("share", [0.5, 0.9])
def test_a_clipped_gyro_is_told_from_its_column(share):
    flight = flown(SEED, seconds=20.0)
    stop = share * np.max(np.abs(flight["theta_dot"]))
    made, said = asked(flight | {"theta_dot": np.clip(flight["theta_dot"], -stop, stop)})
    assert "theta_dot is at an end stop of its sensor (" in said and f"{stop:.4g})" in said
    assert max(off(made), default=0.0) < 3.0
    # the input is held for a row, half a row later than it is logged: nothing else may be said against the window
    assert made.report["windows"][0]["status"] in ("OK", "UNCHECKED") or [
        lack["what"] for lack in made.report["lacks"]] == ["delay"]


def test_a_window_at_the_stop_is_not_ok():
    """What is left of theta_dot are stretches of a few rows, in which nothing can be tested."""
    flight = flown(0)
    stop = 0.02 * np.max(np.abs(flight["theta_dot"]))
    made, _ = asked(flight | {"theta_dot": np.clip(flight["theta_dot"], -stop, stop)}, 0.5)
    assert max(off(made), default=0.0) < 3.0
    assert {w["status"] for w in made.report["windows"]} != {"OK"}


def test_a_clipped_attitude_that_is_quantised_too():
    quantum, flight = 1e-4, flown(1, seconds=20.0)
    stop = round(0.6 * np.max(np.abs(flight["theta"])), 4)
    theta = np.clip(flight["theta"], -stop, stop)
    made, said = asked(flight | {"theta": np.round(theta / quantum) * quantum})
    assert "theta is at an end stop" in said
    assert max(off(made), default=0.0) < 3.0


def test_a_command_s_limit_is_no_sensor_s_stop():
    """The nozzle is there: the rows at the limit are as good as any."""
    flight = flown(2, seconds=20.0, limit=0.6 * float(np.max(np.abs(flown(2)["beta"]))))
    made, said = asked(flight)
    assert end_stops(flight["beta"]).sum() > 100 and "end stop" not in said
    assert np.isfinite(made.log.beta).all() and max(off(made), default=0.0) < MOST


@pytest.mark.parametrize("x", [
    pytest.param(lambda t, rng: np.round(np.sin(0.7 * t), 2), id="the crest of a quantised sine"),
    pytest.param(lambda t, rng: np.round(0.01 * rng.normal(size=len(t)), 3), id="noise of a few quanta"),
    pytest.param(lambda t, rng: np.where(t < 5.0, 0.3, 0.3 + 0.1 * np.sin(t - 5.0) ** 2), id="at rest at first"),
    pytest.param(lambda t, rng: 0.2 * (1.0 - np.exp(-np.minimum(t, 40.0 / 2.0))), id="comes to rest"),
    pytest.param(lambda t, rng: slower(rng.normal(size=len(t)), 10, HELD_WORD), id="a slower channel"),
    pytest.param(lambda t, rng: np.full(len(t), 0.2), id="constant"),
    pytest.param(lambda t, rng: rng.normal(size=len(t)), id="noise")])
def test_what_is_no_end_stop(x):
    t = np.arange(0.0, 20.0, ROW)
    theta = x(t, np.random.default_rng(1))
    assert not end_stops(theta).any()
