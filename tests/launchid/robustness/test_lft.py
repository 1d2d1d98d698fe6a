"""The LFT is exact at any delta, and the range fitted to flights holds the share that it promises.

The LFT is compared with the loop perturbed by hand and with python-control's; the range's factors with tables.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

import launchid
from launchid.log.log import Log, flown_log
from launchid.robustness import greybox as gb
from launchid.robustness.lft import (
    checked,
    close,
    exponential,
    frequency_response,
    lft_at,
    sample,
    star,
)
from sim.errors import InputError
from sim.flight import fly_whole
from sim.nominal import BUILT_IN, Nominal, Profile, built_in, constant_profile, load_nominal
from sim.plant import dispersion

linalg = pytest.importorskip("scipy.linalg")

OMEGA = np.array([0.01, 0.1, 0.5, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 40.0, 80.0, 150.0, 250.0, 310.0])  # rad/s
DELAYS = (0.0, 0.004, 0.01, 0.023)  # s: none, part of a period, a whole one, both


def delayed(nominal: Nominal, delay: float) -> Nominal:
    return replace(nominal, actuator=replace(nominal.actuator, delay=delay))


def plant(nominal: Nominal, t: float, delta) -> tuple[np.ndarray, np.ndarray]:
    """A (..., 4, 4) and B (4, 1) of theta, theta_dot, beta, beta_dot with the parameters perturbed by hand."""
    delta = np.asarray(delta)
    a6, k1 = nominal.vehicle.at(t)
    sigma_a6, sigma_k1 = nominal.uncertainty.at(t)
    w, zeta = nominal.actuator.natural_frequency, nominal.actuator.damping_ratio
    a = np.zeros((*delta.shape[:-1], 4, 4))
    a[..., 0, 1] = a[..., 2, 3] = 1.0
    a[..., 1, 0], a[..., 1, 2] = a6 * (1 + sigma_a6 * delta[..., 0]), k1 * (1 + sigma_k1 * delta[..., 1])
    a[..., 3, 2], a[..., 3, 3] = -w**2, -2 * zeta * w
    return a, np.array([[0.0], [0.0], [0.0], [w**2]])


def held(a: np.ndarray, b: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
    """exp(a h) and the integral of exp(a s) b over h, by scipy's expm of the augmented matrix (Van Loan)."""
    n = a.shape[-1]
    full = np.zeros((*a.shape[:-2], n + 1, n + 1))
    full[..., :n, :n], full[..., :n, n:] = a, b
    e = linalg.expm(full * h)
    return e[..., :n, :n], e[..., :n, n:]


def direct(nominal: Nominal, t: float, delta, omega: np.ndarray) -> np.ndarray:
    """Closed loop (..., p, 2) theta_ref -> (theta, command) as G C/(1 - G C) with transfer functions in z.

    Delay within a period: Astrom & Wittenmark, Computer-Controlled Systems, the input split at the delay.
    """
    controller, period = nominal.controller, nominal.controller.period
    tau = controller.derivative_time_constant
    whole, rest = divmod(nominal.actuator.delay, period)
    if period - rest < 1e-9:
        whole, rest = whole + 1, 0.0
    a, b = plant(nominal, t, delta)
    ad, bd = (x[..., None, :, :] for x in held(a, b, period))
    z = np.exp(1j * omega * period)
    entry = bd.astype(complex)
    if rest > 0.0:
        late_a, late_b = (x[..., None, :, :] for x in held(a, b, period - rest))
        entry = late_b + late_a @ held(a, b, rest)[1][..., None, :, :] / z[:, None, None]
    g = np.linalg.solve(z[:, None, None] * np.eye(4) - ad, entry)[..., 0, 0] / z**whole
    c = controller.kp + controller.kd * (1 - 1 / z) / (tau + period - tau / z)
    return np.stack([-g * c / (1 - g * c), -c / (1 - g * c)], axis=-1)


# ---- the law: F_u(M, Delta) is the perturbed loop


@pytest.mark.parametrize(("name", "t", "delay"), [
    ("constant", 0.0, None), ("vega_like", 50.0, None), ("greensite_cr826", 76.0, None),
    *(("constant", 0.0, delay) for delay in DELAYS)])
def test_lft_is_the_directly_perturbed_loop_at_a_thousand_deltas(name, t, delay):
    nominal = load_nominal(name) if delay is None else delayed(load_nominal(name), delay)
    deltas = np.random.default_rng(1).uniform(-1.0, 1.0, (1000, 2))
    ours = frequency_response(lft_at(nominal, t), deltas, OMEGA)
    assert ours.shape == (1000, len(OMEGA), 2)
    assert np.max(np.abs(ours / direct(nominal, t, deltas, OMEGA) - 1.0)) < 1e-10


def test_simulated_loop_follows_the_lft():
    """The flight code, noise-free and unsaturated, against the LFT's recursion at the controller's ticks."""
    nominal = delayed(load_nominal("constant"), 0.014)
    quiet = replace(nominal.sensors, theta_std=0.0, theta_dot_std=0.0, beta_std=0.0)
    nominal = replace(nominal, sensors=quiet, actuator=replace(nominal.actuator, command_noise_std=0.0),
                      simulation=replace(nominal.simulation, duration=20.0, acceleration_noise_std=0.0))
    delta = np.array([0.7, -0.4])
    flight = fly_whole(nominal, a6_factor=1.0 + 0.25 * delta[0], k1_factor=1.0 + 0.25 * delta[1])
    loop = sample(lft_at(nominal, 0.0), delta)
    a, b = close(loop), loop.b_reference + loop.b * loop.command_reference
    x = np.zeros(len(a))
    theta = np.empty(len(flight.t))
    for k, reference in enumerate(flight.theta_ref):
        theta[k] = x[0]
        x = a @ x + b * reference
    assert np.max(np.abs(flight.theta - theta)) < 1e-6 * np.max(np.abs(theta))


# ---- minimal, nominal at zero, exact pieces


def test_each_delta_enters_once():
    lft = lft_at(load_nominal("vega_like"), 50.0)
    assert lft.b.shape[1] == lft.c.shape[0] == 2
    for delta, row, column in (((1.0, 0.0), 1, 0), ((0.0, 1.0), 1, 2)):
        change = star(lft, np.array(delta)) - lft.a
        assert np.linalg.matrix_rank(change) == 1 and np.flatnonzero(change).tolist() == [row * len(lft.a) + column]


@pytest.mark.parametrize("name", BUILT_IN)
def test_zero_delta_is_the_nominal(name):
    lft = lft_at(load_nominal(name), 30.0)
    assert np.array_equal(star(lft, np.zeros(2)), lft.a)
    a6, k1 = load_nominal(name).vehicle.at(30.0)
    assert lft.a[1, 0] == a6 and lft.a[1, 2] == k1


@pytest.mark.parametrize("scale", (0.0, 1e-9, 0.3, 5.0, 60.0))
def test_exponential_is_scipys(scale):
    a = scale * np.random.default_rng(4).standard_normal((3, 6, 6)) / 6.0
    for mine, matrix in zip(exponential(a), a, strict=True):
        assert np.allclose(mine, linalg.expm(matrix), rtol=1e-11, atol=1e-12 * np.abs(mine).max())


def test_plant_whose_pole_is_met_on_the_circle():
    """a6 = 0 at omega = 0: the plant's double pole.  The closed loop is finite there: theta follows theta_ref."""
    nominal = replace(load_nominal("constant"), vehicle=constant_profile(0.0, -7.0))
    response = frequency_response(lft_at(nominal, 0.0), (0.0, 0.0), np.array([0.0, 1.0]))
    assert response[0, 0] == pytest.approx(1.0, abs=1e-6)


# ---- refusals


@pytest.mark.parametrize("delta", [(1.01, 0.0), (0.0, -1.5), (np.nan, 0.0), (0.1, 0.2, 0.3)])
def test_delta_outside_its_range(delta):
    with pytest.raises(ValueError, match=r"expected delta_a6, delta_k1 within \[-1, 1\]"):
        checked(delta)


@pytest.mark.parametrize(("name", "sections", "t", "said"), [
    *(("constant", {section: None}, 0.0, rf"\[{section}\] is missing")
      for section in ("uncertainty", "actuator", "controller")),
    *(("vega_like", {}, t, "expected a time from 0 to 95 s") for t in (-0.1, 95.1, np.nan, np.inf)),
    *(("constant", {"uncertainty": constant_profile(0.25, sigma)}, 0.0, "expected sigma above 0")
      for sigma in (0.0, -0.25))])
def test_a_missing_section_a_time_outside_and_a_sigma_of_nothing_are_named(name, sections, t, said):
    with pytest.raises(InputError, match=said):
        lft_at(replace(load_nominal(name), **sections), t)


def test_sigma_profile_that_does_not_cover_the_time():
    sigma = Profile(np.array([0.0, 40.0]), np.array([0.25, 0.1]), np.array([0.25, 0.1]))
    nominal = replace(load_nominal("vega_like"), uncertainty=sigma)
    assert lft_at(nominal, 20.0).sigma == pytest.approx([0.175, 0.175])
    with pytest.raises(InputError, match=r"\[uncertainty\]: t = 50.0 s"):
        lft_at(nominal, 50.0)


FLIGHTS = 30


@pytest.mark.parametrize("n", [8, 30, 80])
def test_the_range_holds_its_share_with_its_confidence(n):
    """Normal deviations seen through noise as large as a third of them."""
    rng = np.random.default_rng(11)
    trials, spread, noise = 400, 0.1, 0.03
    enough = 0
    for _ in range(trials):
        value = spread * rng.standard_normal(n) + noise * rng.standard_normal(n)
        sigma = gb.fit_range(value, np.full(n, noise), 0.0, 0.95, 0.95).sigma
        enough += math.erf(sigma / spread / math.sqrt(2.0)) >= 0.95
    assert enough / trials >= 0.95 - 3.0 * math.sqrt(0.05 * 0.95 / trials)


def test_flights_that_are_the_nominal_leave_a_small_range_above_zero():
    rng = np.random.default_rng(4)
    fitted = gb.fit_range(0.01 * rng.standard_normal(30), np.full(30, 0.01), 0.0, 0.95, 0.95)
    assert 0.0 < fitted.sigma < 0.03


def test_a_deviation_that_moves_within_the_flights_widens_the_range():
    t = np.arange(5.0, 75.0, 10.0)
    rng = np.random.default_rng(6)
    std = np.full((len(t), 2), 0.01)

    def flights(amplitude: float) -> list[gb.Deviations]:
        return [gb.Deviations("", (0.0, 70.0), t, np.stack([amplitude * np.sin(t / 9.0 + phase)] * 2, axis=1)
                              + 0.01 * rng.standard_normal(std.shape), std) for phase in rng.uniform(0.0, 6.3, 40)]
    still, moving = (gb.fit(flights(a), 0.95, 0.95).ranges[0] for a in (0.0, 0.2))
    assert still.within < 0.01 and moving.within == pytest.approx(0.2 / math.sqrt(2.0), rel=0.2)
    assert 0.2 < moving.sigma < 0.5


@pytest.fixture(scope="module")
def flown() -> tuple[list[Log], np.ndarray]:
    """30 flights of the constant nominal with delta uniform in the box of 0.25, and delta."""
    nominal = load_nominal(built_in("constant"))
    delta = np.random.default_rng(21).uniform(-1.0, 1.0, (FLIGHTS, 2))
    return [flown_log(fly_whole(nominal, k, a6_factor=a6_factor, k1_factor=k1_factor)) for k, (a6_factor, k1_factor)
            in enumerate(dispersion(nominal, *each) for each in delta)], delta


@pytest.mark.campaign
def test_thirty_flights_give_a_range_that_holds_them(flown, tmp_path):
    logs, delta = flown
    made = launchid.fit_lft(logs, "constant")
    assert "sigma_a6" in made.summary()
    made.write(tmp_path / "new.toml")
    fitted = load_nominal(tmp_path / "new.toml").uncertainty
    for sigma, true in ((fitted.a6, 0.25 * delta[:, 0]), (fitted.k1, 0.25 * delta[:, 1])):
        assert len(sigma) == 1
        assert np.mean(np.abs(true) <= sigma[0]) >= 0.95
        assert sigma[0] < 2.0 * np.max(np.abs(true))
    assert launchid.uncertainty(logs[0], tmp_path / "new.toml").report["windows"]


def test_a_range_over_flight_time_is_written_beside(flown, tmp_path):
    logs, delta = flown
    launchid.fit_lft(logs[:12], "constant", profile=True).write(tmp_path / "timed.toml")
    assert (tmp_path / "timed.uncertainty.csv").is_file()
    sigma = load_nominal(tmp_path / "timed.toml").uncertainty
    assert len(sigma.t) == 9  # seven bins of 10 s, and the flight's ends
    assert (sigma.a6[:, None] >= np.abs(0.25 * delta[:12, 0])).mean() >= 0.95
    assert launchid.uncertainty(logs[0], tmp_path / "timed.toml").report["windows"]
