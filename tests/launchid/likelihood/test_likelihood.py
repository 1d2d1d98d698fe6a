"""The likelihood: what a known vehicle leaves is white, and a run depends on its parameters alone."""

import math

import numpy as np
import pytest

from launchid.likelihood import kernel
from launchid.likelihood.likelihood import Parameters, Run, follow, predict, respond, run

PERIOD, FINE, ROWS = 0.02, 0.001, 1000   # s of a row, of the truth's step; rows
A6, K1 = 2.0, -7.0
SERVO = 40.0, 0.7                        # rad/s, damping ratio
SLOSH = 5.0, 0.02, 0.08                  # rad/s, damping ratio, coupling
BENDING = 20.0, 0.02, 0.3                # rad/s, damping ratio, gain
STD = np.array([4e-4, 5e-4, 3e-4])       # rad, rad/s, rad


def slopes(x: np.ndarray, u: float) -> np.ndarray:
    """Slopes of theta, theta_dot, nozzle, its rate, slosh and its rate, bending and its rate."""
    (w, z), (ws, zs, cs), (wb, zb, _) = SERVO, SLOSH, BENDING
    omega_dot = A6 * x[0] + K1 * x[2] + cs * ws**2 * x[4]
    return np.array([x[1], omega_dot, x[3], w * w * (u - x[2]) - 2.0 * z * w * x[3],
                     x[5], -omega_dot - 2.0 * zs * ws * x[5] - ws**2 * x[4],
                     x[7], wb**2 * (x[2] - x[6]) - 2.0 * zb * wb * x[7]])


@pytest.fixture(scope="module")
def flown() -> tuple[np.ndarray, np.ndarray]:
    """Measurements (rows, 3) and commands (rows,) of a closed loop with slosh and bending, by Runge and Kutta."""
    rng, x, z, u = np.random.default_rng(8), np.zeros(8), np.empty((ROWS, 3)), np.empty(ROWS)
    x[0] = 0.02
    for k in range(ROWS):
        z[k] = [x[0] + BENDING[2] * x[6], x[1] + BENDING[2] * x[7], x[2]] + STD * rng.standard_normal(3)
        u[k] = 0.8 * x[0] + 0.5 * x[1] + 0.02 * np.sign(math.sin(0.9 * k * PERIOD))   # nobody feeds the modes back
        for _ in range(round(PERIOD / FINE)):
            a = slopes(x, u[k])
            b = slopes(x + 0.5 * FINE * a, u[k])
            c = slopes(x + 0.5 * FINE * b, u[k])
            x = x + FINE / 6.0 * (a + 2.0 * b + 2.0 * c + slopes(x + FINE * c, u[k]))
    return z, u


def numbers(**given: float) -> np.ndarray:
    n = np.zeros(1, kernel.NUMBERS)
    for name, value in ({"gyro_scale": 1.0, "sign_rate": 1.0, "walk_time": math.inf, "turbulence_time": 1.0,
                         "servo": kernel.SECOND_ORDER_SERVO, "frequency": SERVO[0], "damping_ratio": SERVO[1],
                         "command_period": PERIOD, "theta_noise": STD[0], "theta_dot_noise": STD[1],
                         "beta_noise": STD[2], "acceleration_noise": 1e-5, "theta_start": 1.0, "omega_start": 1.0,
                         "b_start": 1e-4, "v_start": 1e-2, "longest_gap": 1.0} | given).items():
        n[name] = value
    return n


def parameters(z: np.ndarray, u: np.ndarray, modes: bool = True, **given: float) -> Parameters:
    """The truth's own parameters, four steps a row."""
    rows, m = np.zeros(len(z), kernel.ROW), np.zeros((len(z), 2), kernel.MODE)
    rows["theta"], rows["beta"] = A6, K1
    m[:, 0] = (*SLOSH[:2], 0.0, SLOSH[2] * SLOSH[0]**2, 0.0, 0.0)
    m[:, 1] = (*BENDING[:2], 1.0, 0.0, BENDING[2], BENDING[2])
    return Parameters(PERIOD * np.arange(len(z) + 1), z, np.repeat(u[:, None], 4, axis=1), rows, numbers(**given),
                      m if modes else m[:, :0].copy())


def whitened(made: Run) -> np.ndarray:
    return (made.E / np.sqrt(made.S))[50:]


# ---- a known truth


def test_innovations_of_the_truth_are_white_with_slosh_and_bending(flown):
    e = whitened(run(parameters(*flown)))
    for channel in range(3):
        x = e[:, channel]
        assert np.mean(x**2) == pytest.approx(1.0, abs=4.0 * math.sqrt(2.0 / len(x)))
        assert abs(np.corrcoef(x[1:], x[:-1])[0, 1]) < 4.0 / math.sqrt(len(x))


def test_without_the_modes_they_are_not(flown):
    assert np.all(np.mean(whitened(run(parameters(*flown, modes=False)))[:, :2]**2, axis=0) > 2.0)


def test_what_it_foresees_errs_as_much_as_it_says(flown):
    made = run(parameters(*flown), covariances=True)
    errors, variances = predict(made, np.arange(100, ROWS - 30, 10), np.array([5, 25]))
    ratio = np.mean(errors**2 / variances, axis=0)
    assert np.all(ratio[:, 1:] < 1.5)
    assert np.all(ratio[:, 1:] > 0.6)


@pytest.mark.parametrize("ratio", [0.7, 1.6])
def test_a_servo_answers_a_step_as_its_equation(ratio):
    w, t = 8.0, PERIOD * np.arange(100)
    nobody = np.full((100, 3), np.nan)
    made = run(parameters(nobody, np.append(0.0, np.ones(99)), frequency=w, damping_ratio=ratio))
    poles = np.roots([1.0, 2.0 * ratio * w, w * w])
    since = np.maximum(t - PERIOD, 0.0)
    exact = 1.0 + (poles[1] * np.exp(poles[0] * since) - poles[0] * np.exp(poles[1] * since)) / (poles[0] - poles[1])
    assert made.X[1:, kernel.B] == pytest.approx(exact.real[1:], abs=1e-12)


def test_a_swing_has_its_period_to_the_second_order_of_the_step():
    w, nobody = 4.5, np.full((200, 3), np.nan)
    nobody[0, :2] = 0.3, 0.0
    p = parameters(nobody, np.zeros(200), modes=False, acceleration_noise=0.0)
    p.rows["theta"] = -w * w
    ends = [run(p._replace(u=np.zeros((200, steps)))).X[:, kernel.TH] - 0.3 * np.cos(w * p.t[:-1]) for steps in (1, 2)]
    assert np.max(np.abs(ends[1])) < np.max(np.abs(ends[0])) / 3.5 < 2e-3


def test_a_servo_alone_is_a_vehicle_that_nobody_measures(flown):
    z, u = flown
    alone = np.where([False, False, True], z, np.nan)
    x = whitened(run(parameters(alone, u, modes=False)))[:, 2]
    assert np.mean(x**2) == pytest.approx(1.0, abs=4.0 * math.sqrt(2.0 / len(x)))


def test_a_nozzle_of_its_own_is_told_by_its_sensor():
    """A slow swing among noise: filtered it is known better than one row shows it."""
    t, z = PERIOD * np.arange(ROWS), np.full((ROWS, 3), np.nan)
    swing = 0.02 * np.sin(1.5 * t)
    z[:, 2] = swing + STD[2] * np.random.default_rng(2).standard_normal(ROWS)
    made = run(parameters(z, np.zeros(ROWS), servo=kernel.FREE_NOZZLE, frequency=1.0, command_noise=0.03))
    assert np.std((made.X[:, kernel.B] - swing)[50:]) < 0.75 * STD[2]
    assert np.mean(whitened(made)[:, 2]**2) == pytest.approx(1.0, abs=0.2)


def test_without_a_servo_the_command_is_the_nozzle(flown):
    z, u = flown
    made = run(parameters(np.where([True, True, False], z, np.nan), u, servo=kernel.NO_SERVO, b_start=0.0, v_start=0.0))
    assert np.array_equal(made.X[1:, kernel.B], u[:-1])


# ---- laws


def test_the_same_parameters_give_the_same_bits_and_stay_as_they_are(flown):
    given, again = parameters(*flown), parameters(*flown)
    first, other = run(given), run(parameters(*flown, theta_noise=1e-2))
    second = run(given)
    assert not np.array_equal(first.E, other.E)
    for before, after in zip(first[1:], second[1:], strict=True):
        assert np.array_equal(before, after, equal_nan=True)
    for before, after in zip(again, given, strict=True):
        assert before.tobytes() == after.tobytes()


def test_with_its_own_parameters_a_run_is_followed_to_the_bit(flown):
    made = run(parameters(*flown))
    assert np.array_equal(follow(made, made.parameters), made.E)


@pytest.mark.parametrize("modes", [False, True])
def test_a_small_force_changes_the_innovations_as_following_says(flown, modes):
    made, force, none = run(parameters(*flown, modes=modes)), np.zeros(ROWS), np.zeros(ROWS)
    force[300:500] = 1e-4
    rows = made.parameters.rows.copy()
    rows["force"] += force
    exact = follow(made, made.parameters._replace(rows=rows)) - made.E
    linear = respond(made, force, none, np.zeros((ROWS, 3)), 4)
    for channel in range(3):
        assert np.std(linear[:, channel] - exact[:, channel]) <= 0.02 * np.std(exact[:, channel]) + 1e-15


# ---- degenerate cases


def test_after_a_gap_the_motion_is_unknown_again(flown):
    z, u = flown
    p = parameters(z, u)
    t = p.t.copy()
    t[400:] += 5.0
    made = run(p._replace(t=t))
    assert made.S[400, 0] > 0.9 and made.S[400, 1] > 0.9 and made.E[400, 0] == 0.0
    assert np.all(made.S[420:, 0] < 1e-5)


def test_a_vehicle_that_runs_away_is_set_back(flown):
    z, u = flown
    p = parameters(z, u)
    p.rows["theta"] = 1e8
    assert np.all(np.isfinite(run(p).X))
