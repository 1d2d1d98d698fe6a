"""The bound where the servo is not known: against the likelihood of a plain filter, against what the answer must be."""

import dataclasses

import numpy as np
import pytest

from launchid.bound.flights import flight_bound, switched
from launchid.bound.information import DIFFUSE, WITH_SERVO, window_information, without_offset
from launchid.bound.modes import NO_MODES
from launchid.bound.step import FIRST_ORDER, transition
from sim.errors import InputError
from sim.nominal import Nominal, Offsets, Wind, load_nominal, nominal_lines

linalg = pytest.importorskip("scipy.linalg")

TRUTH, PERIOD, ROWS = np.array([2.0, -7.0, 20.0, 0.7, 0.013]), 0.01, 300
NOISES = np.array([3.5e-4, 5.2e-4, 3.5e-4, 7e-4, 8.7e-4])**2


def generator(a6: float, k1: float, w: float, zeta: float) -> np.ndarray:
    """A of theta, theta_dot, beta, beta_dot and the held command and acceleration."""
    a = np.zeros((6, 6))
    a[0, 1] = a[1, 5] = a[2, 3] = 1.0
    a[1, 0], a[1, 2], a[3, 2:5] = a6, k1, (-w * w, -2 * zeta * w, w * w)
    return a


# ---- the pieces


@pytest.mark.parametrize("damping", [0.4, 0.7, 1.0, 1.3, FIRST_ORDER])
@pytest.mark.parametrize("h", [0.002, 0.01, 0.05])
def test_the_servos_derivatives_are_the_central_differences(damping, h):
    values = [2.0, -7.0, 35.0, damping]
    slopes = np.zeros((4, 6, 6))
    transition(np.array(values), NO_MODES.bends, h, np.zeros((6, 6)), slopes)
    for m, step in ((2, 1e-3), (3, 1e-5)):
        if m == 3 and damping == FIRST_ORDER:
            assert not slopes[3].any()
            continue
        ends = []
        for side in (1.0, -1.0):
            f, moved = np.zeros((6, 6)), list(values)
            moved[m] += side * step
            transition(np.array(moved), NO_MODES.bends, h, f, np.zeros((2, 6, 6)))
            ends.append(f)
        assert np.allclose(slopes[m], (ends[0] - ends[1]) / (2 * step), rtol=1e-5, atol=1e-8)


# ---- a plain filter of the same vehicle, by matrix exponentials alone


def driven(p: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The transition (6, 6) over a period, and what a command (count, ROWS), delayed, moves the state by (count, ROWS,
    4): the older one until it is due, then the newer."""
    whole = int(p[4] / PERIOD)
    first = p[4] - whole * PERIOD
    a = generator(*p[:4])
    before, after = linalg.expm(a * first), linalg.expm(a * (PERIOD - first))
    past = np.concatenate([np.zeros((len(u), whole + 1)), u], axis=1)
    older, newer = past[:, :u.shape[1]], past[:, 1:u.shape[1] + 1]
    moved = older[..., None] * (after[:4, :4] @ before[:4, 4]) + newer[..., None] * after[:4, 4]
    return after @ before, moved


def drawn(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Measurements (count, ROWS, 3) and commands (count, ROWS) of loops with a test input."""
    random = np.random.default_rng(seed)
    t = np.arange(ROWS) * PERIOD
    shake = 0.03 * np.sin(2.0 * t) + 0.02 * np.sin(7.0 * t) + 0.01 * np.sin(19.0 * t)
    x, z, u = 1e-3 * random.standard_normal((count, 4)), np.empty((count, ROWS, 3)), np.empty((count, ROWS))
    u[:] = 0.0
    for k in range(ROWS):
        z[:, k] = x[:, :3] + random.standard_normal((count, 3)) * np.sqrt(NOISES[:3])
        u[:, k] = 1.2 * z[:, k, 0] + 0.5 * z[:, k, 1] + shake[k]
        f, moved = driven(TRUTH, u[:, max(k - 3, 0):k + 1])
        x = x @ f[:4, :4].T + moved[:, -1] + random.standard_normal((count, 2)) * np.sqrt(NOISES[3:]) @ f[:4, 4:].T
    return z, u


def likelihood(z: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Log-likelihood (count,) at parameters (5,), the filter's start unknown."""
    f, moved = driven(p, u)
    q = f[:4, 4:] @ np.diag(NOISES[3:]) @ f[:4, 4:].T
    h, noise = np.eye(3, 4), np.diag(NOISES[:3])
    x, cov, total = np.zeros((len(z), 4)), np.diag(DIFFUSE**2), np.zeros(len(z))
    for k in range(ROWS):
        s = h @ cov @ h.T + noise
        gain = cov @ h.T @ np.linalg.inv(s)
        e = z[:, k] - x[:, :3]
        total -= 0.5 * (np.linalg.slogdet(s)[1] + np.einsum("ci,ij,cj->c", e, np.linalg.inv(s), e))
        rest = np.eye(4) - gain @ h
        x = (x + e @ gain.T) @ f[:4, :4].T + moved[:, k]
        cov = f[:4, :4] @ (rest @ cov @ rest.T + gain @ noise @ gain.T) @ f[:4, :4].T + q
    return total


def informed(z: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Information (count, 5, 5) and score (count, 5) of the module under test, each log one window."""
    information, scores = np.zeros((len(z), 9, 9)), np.zeros((len(z), 9))
    for k in range(len(z)):
        table, score = np.zeros((1, WITH_SERVO, WITH_SERVO)), np.zeros((1, WITH_SERVO))
        older, newer, switch = switched(u[k], TRUTH[4], PERIOD)
        window_information(np.arange(ROWS) * PERIOD, z[k], older, np.full(ROWS, TRUTH[0]), np.full(ROWS, TRUTH[1]),
                           TRUTH[2:4], NOISES, np.zeros(ROWS, np.int64), table, np.zeros(ROWS), newer=newer,
                           switch=switch, score=score)
        information[k], scores[k] = table[0], score[0]
    explained = np.linalg.solve(information[:, :4, :4], scores[:, :4, None])[:, :, 0]
    return without_offset(information), scores[:, 4:] - np.einsum("kij,ki->kj", information[:, :4, 4:], explained)


UNIT = np.array([2.0, -7.0, 20.0, 0.7, 1.0])  # what the information is relative to; the delay in s
STEPS = np.array([0.02, 0.02, 0.02, 0.03, 0.0004])


def test_information_is_the_curvature_of_a_plain_filters_likelihood():
    """Both are the Fisher information in the mean over logs, of which one draws the curvature and one the score."""
    z, u = drawn(120, 1)
    around = {(0,) * 5: likelihood(z, u, TRUTH).mean()}
    eye = np.eye(5, dtype=int)
    at = [sign * (eye[i] + (eye[j] if j != i else 0)) for i in range(5) for j in range(i, 5) for sign in (1, -1)]
    for move in at:
        around[tuple(move)] = likelihood(z, u, TRUTH + UNIT * STEPS * move).mean()
    bend = np.zeros((5, 5))
    here = around[(0,) * 5]
    for i in range(5):
        bend[i, i] = around[tuple(eye[i])] + around[tuple(-eye[i])] - 2 * here
    for i in range(5):
        for j in range(i):
            both = around[tuple(eye[i] + eye[j])] + around[tuple(-eye[i] - eye[j])] - 2 * here
            bend[i, j] = bend[j, i] = 0.5 * (both - bend[i, i] - bend[j, j])
    curvature = -bend / np.outer(STEPS, STEPS)
    information = informed(z, u)[0].mean(axis=0)
    scale = np.sqrt(np.diag(curvature))
    assert np.allclose(information / np.outer(scale, scale), curvature / np.outer(scale, scale), atol=0.04)
    assert np.allclose(np.diag(np.linalg.inv(information)), np.diag(np.linalg.inv(curvature)), rtol=0.12)


def test_the_score_is_the_likelihoods_slope_and_spreads_as_the_information_says():
    z, u = drawn(200, 2)
    information, score = informed(z, u)
    for i in range(5):
        step = np.eye(5)[i] * UNIT * STEPS * 0.05
        slope = (likelihood(z, u, TRUTH + step) - likelihood(z, u, TRUTH - step)) / (2 * 0.05 * STEPS[i])
        scale = np.sqrt(information[:, i, i].mean())
        assert np.corrcoef(slope, score[:, i])[0, 1] > 0.99
        assert abs(np.mean(score[:, i])) < 4.0 * scale / np.sqrt(len(z))
    normed = np.einsum("ki,kij,kj->k", score, np.linalg.inv(information), score)  # chi-square of five
    assert np.mean(normed) == pytest.approx(5.0, abs=5 * np.sqrt(10.0 / len(z)))


# ---- of a nominal


def unsure(name: str = "constant", **sigma: float) -> Nominal:
    nominal = load_nominal(name)
    sigma = sigma or {"natural_frequency_sigma": 0.3, "damping_ratio_sigma": 0.3, "delay_sigma": 0.01}
    return dataclasses.replace(nominal, simulation=dataclasses.replace(nominal.simulation, duration=30.0),
                               actuator=dataclasses.replace(nominal.actuator, **sigma))


@pytest.mark.parametrize("air", [{}, {"wind": Wind(walk=0.005, turbulence=0.005), "offsets": Offsets(0.004, 0.005)}])
def test_not_knowing_the_servo_never_lowers_the_bound(air):
    nominal = dataclasses.replace(unsure(), **air)
    sure = dataclasses.replace(nominal, actuator=load_nominal("constant").actuator)
    known, unknown = flight_bound(sure, 5.0), flight_bound(nominal, 5.0)
    assert (unknown.a6 >= known.a6 * (1 - 1e-9)).all() and (unknown.k1 > known.k1).all()
    assert (unknown.servo < [0.3, 0.3, 0.01]).all() and known.servo.shape == (6, 0)


def test_a_servo_that_is_all_but_known_leaves_the_bound():
    tiny = unsure(natural_frequency_sigma=1e-7, damping_ratio_sigma=1e-7, delay_sigma=1e-9)
    sure = dataclasses.replace(tiny, actuator=load_nominal("constant").actuator)
    assert np.allclose(flight_bound(tiny, 5.0).k1, flight_bound(sure, 5.0).k1, rtol=1e-6)


def test_the_keys_are_read_checked_and_written(tmp_path):
    nominal = unsure()
    path = tmp_path / "a.toml"
    path.write_text("\n".join(nominal_lines(nominal, path)) + "\n")
    assert load_nominal(path).actuator == nominal.actuator and not load_nominal(path).actuator.is_known
    text = path.read_text()
    path.write_text(text.replace("delay_sigma = 0.01", "delay_sigma = -0.01"))
    with pytest.raises(InputError, match=r"actuator.delay_sigma = -0.01: expected a number of at least 0"):
        load_nominal(path)
    first = text.replace("natural_frequency = 50.0", "time_constant = 0.02").replace("damping_ratio = 0.7\n", "")
    path.write_text(first)
    with pytest.raises(InputError, match="time_constant and natural_frequency_sigma"):
        load_nominal(path)
