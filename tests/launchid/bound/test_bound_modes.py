"""The bound with slosh and bending: against the Fisher information of all rows at once, a dense Gaussian model."""

import dataclasses

import numpy as np
import pytest

from launchid.bound.flights import flight_bound
from launchid.bound.information import window_information, without_offset
from launchid.bound.modes import Modes
from launchid.bound.world import MISALIGNMENT_STATE, TURBULENCE_STATE, World, calm
from sim.nominal import Nominal, load_nominal
from sim.sections import Bending, Slosh, constant

linalg = pytest.importorskip("scipy.linalg")

PERIOD, ROWS, LOGS = 0.04, 100, 150
TRUTH = np.array([2.0, -7.0, 3.5, 0.06, 0.02, 20.0, 0.03, 0.01])   # a6, k1; of slosh, then bending: w, size, damping
SERVO = np.array([30.0, 0.7])
AT_GYRO = 0.8     # of bending, over what the attitude's sensor shows
NOISES = np.array([3.5e-4, 5.2e-4, 3.5e-4, 7e-4, 8.7e-4])**2
TURBULENCE, TURBULENCE_TIME, MISALIGNMENT = 0.01, 1.5, 0.004
VEHICLE, AIR = 8, 2
MODES = Modes(np.array([0, 1]), TRUTH[2:].reshape(1, 2, 3), np.array([[0.0, 0.0], [1.0, AT_GYRO]]), np.zeros((2, 3)))
START = np.array([0.01, -0.005, 0.004, 0.0, 0.0, 0.0, 0.0, 0.0])   # of the vehicle, as the filter under test begins
T = np.arange(ROWS) * PERIOD
COMMAND = 0.03 * np.sin(2.0 * T) + 0.02 * np.sin(7.0 * T) + 0.01 * np.sin(19.0 * T) + 0.004 * np.sign(np.sin(1.3 * T))


def equations(p: np.ndarray) -> np.ndarray:
    """A of theta, theta_dot, beta, beta_dot, psi, psi_dot, eta, eta_dot, turbulence, misalignment; command,
    acceleration."""
    a6, k1, ws, coupling, zs, wb, gain, zb = p
    w, z = SERVO
    a = np.zeros((12, 12))
    a[0, 1] = a[2, 3] = a[4, 5] = a[6, 7] = 1.0
    a[1, [0, 2, 4, 8, 9, 11]] = a6, k1, coupling * ws**2, a6, k1, 1.0
    a[3, [2, 3, 10]] = -w**2, -2 * z * w, w**2
    a[5] = -a[1]
    a[5, 4] -= ws**2
    a[5, 5] -= 2 * zs * ws
    a[7, [6, 7, 2]] = -wb**2, -2 * zb * wb, gain * wb**2
    a[8, 8] = -1.0 / TURBULENCE_TIME
    return a


SEEN = np.zeros((3, 10))
SEEN[[0, 1, 2], [0, 1, 2]] = 1.0
SEEN[0, 6], SEEN[1, 7] = 1.0, AT_GYRO


def all_rows(p: np.ndarray, is_windy: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean of all measurements (3 ROWS,), their slopes in the vehicle's first state (3 ROWS, 8), their covariance."""
    a, n = equations(p), 10
    f = linalg.expm(a * PERIOD)
    white = np.zeros((12, 12))
    white[8, 8] = is_windy * 2.0 * TURBULENCE**2 / TURBULENCE_TIME
    pair = linalg.expm(np.block([[-a, white], [np.zeros((12, 12)), a.T]]) * PERIOD)   # Van Loan, 1978
    q = (pair[12:, 12:].T @ pair[:12, 12:])[:n, :n] + f[:n, 10:] @ np.diag(NOISES[3:]) @ f[:n, 10:].T
    cov = np.zeros((n, n))
    if is_windy:
        cov[8, 8], cov[9, 9] = TURBULENCE**2, MISALIGNMENT**2
    x, slope = np.concatenate([START, np.zeros(AIR)]), np.eye(n)[:, :VEHICLE]
    mean, slopes, covariance = np.zeros((ROWS, 3)), np.zeros((ROWS, 3, VEHICLE)), np.zeros((ROWS, 3, ROWS, 3))
    for k in range(ROWS):
        mean[k], slopes[k] = SEEN @ x, SEEN @ slope
        later = cov
        for j in range(k, ROWS):
            covariance[j, :, k] = SEEN @ later @ SEEN.T
            covariance[k, :, j] = covariance[j, :, k].T
            later = f[:n, :n] @ later
        covariance[k, :, k] += np.diag(NOISES[:3])
        x, slope, cov = f[:n, :n] @ x + f[:n, 10] * COMMAND[k], f[:n, :n] @ slope, f[:n, :n] @ cov @ f[:n, :n].T + q
    return mean.ravel(), slopes.reshape(-1, VEHICLE), covariance.reshape(3 * ROWS, 3 * ROWS)


def exact(is_windy: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean (3 ROWS,) and covariance of all measurements; Fisher information (8, 8) of the relative numbers, the first
    state unknown: that in the mean, and in wind that in the covariance."""
    mean, starts, covariance = all_rows(TRUTH, is_windy)
    ends = [[all_rows(TRUTH * (1.0 + side * 1e-4 * unit), is_windy) for side in (1.0, -1.0)] for unit in np.eye(8)]
    slopes, changes = ([(up[k] - down[k]) / 2e-4 for up, down in ends] for k in (0, 2))
    weight = np.linalg.inv(covariance)
    weight -= weight @ starts @ np.linalg.solve(starts.T @ weight @ starts, starts.T @ weight)
    information = np.array(slopes) @ weight @ np.transpose(slopes)
    if is_windy:
        own = [weight @ each for each in changes]
        information += 0.5 * np.array([[np.sum(one * other.T) for other in own] for one in own])
    return mean, covariance, information


def made(z: np.ndarray, is_windy: bool) -> np.ndarray:
    world = calm(ROWS)
    if is_windy:
        world = World(np.array([TURBULENCE_STATE, MISALIGNMENT_STATE]),
                      np.array([[TURBULENCE**2], [MISALIGNMENT**2]]) * np.ones(ROWS), np.zeros(2),
                      np.array([TURBULENCE_TIME, np.inf]), np.zeros(ROWS), np.zeros((2, ROWS)), np.zeros(ROWS), 0.0,
                      restarts=True, levels_known=True)
    information = np.zeros((1, 16, 16))
    window_information(T, z.reshape(ROWS, 3), COMMAND, np.full(ROWS, TRUTH[0]), np.full(ROWS, TRUTH[1]), SERVO, NOISES,
                       np.zeros(ROWS, np.int64), information, np.zeros(ROWS), world, modes=MODES)
    return without_offset(information, VEHICLE)[0]


def nearly(made: np.ndarray, right: np.ndarray, off: float) -> None:
    scale = np.sqrt(np.diag(right))
    assert np.allclose(made / np.outer(scale, scale), right / np.outer(scale, scale), atol=off)
    made, right = (np.sqrt(np.diag(np.linalg.inv(each))) for each in (made, right))
    assert np.allclose(made, right, rtol=2.0 * off), (made, right)


def test_the_information_is_that_of_all_rows_at_once():
    mean, _, right = exact(False)
    nearly(made(mean, False), right, 1e-4)


def test_in_wind_it_is_so_in_the_mean_over_logs():
    mean, covariance, right = exact(True)
    root = np.linalg.cholesky(covariance)
    noise = np.random.default_rng(4).standard_normal((LOGS, 3 * ROWS)) @ root.T
    nearly(np.mean([made(mean + each, True) for each in noise], axis=0), right, 0.06)


# ---- of a nominal


def with_modes(**sigma: float) -> Nominal:
    nominal = load_nominal("constant")
    slosh = Slosh(constant(3.5), constant(0.05), constant(0.01), **{f"{key}_sigma": x for key, x in sigma.items()})
    return dataclasses.replace(nominal, simulation=dataclasses.replace(nominal.simulation, duration=20.0),
                               slosh=(slosh,), bending=(Bending(constant(20.0), constant(0.02), constant(0.01)),))


def test_not_knowing_a_mode_never_lowers_the_bound_and_a_mode_all_but_known_leaves_it():
    known, unknown = flight_bound(with_modes(), 5.0), flight_bound(with_modes(frequency=0.1, coupling=0.5), 5.0)
    assert (unknown.a6 >= known.a6 * (1 - 1e-9)).all() and (unknown.k1 >= known.k1 * (1 - 1e-9)).all()
    assert known.modes.shape == (4, 0) and (unknown.modes < [0.1, 0.5]).all()
    tiny = flight_bound(with_modes(frequency=1e-7, coupling=1e-7), 5.0)
    assert np.allclose(tiny.a6, known.a6, rtol=1e-6) and np.allclose(tiny.k1, known.k1, rtol=1e-6)


def test_with_a_servo_that_is_not_known_either_the_numbers_keep_their_places():
    nominal = with_modes(frequency=0.1)
    unsure = dataclasses.replace(nominal, actuator=dataclasses.replace(
        nominal.actuator, natural_frequency_sigma=0.3, damping_ratio_sigma=0.3, delay_sigma=0.01))
    bound, sure = flight_bound(unsure, 5.0), flight_bound(nominal, 5.0)
    assert bound.servo.shape == (4, 3) and bound.modes.shape == (4, 1)
    assert (bound.servo < [0.3, 0.3, 0.01]).all() and (bound.modes < 0.1).all()
    assert (bound.k1 >= sure.k1 * (1 - 1e-9)).all()
