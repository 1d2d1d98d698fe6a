"""Wind, offsets, drift and the check of the model on board: laws against plain numpy, claims against hidden truth."""

import dataclasses
import functools
import math
from statistics import NormalDist

import numba
import numpy as np
import pytest
from cut import copied, cut_of, fed, scratch, take
from shortened import CALM, WINDY
from unjitted import unjitted

from launchid.identification.windows import run
from launchid_core import Config, Estimate, Estimator, Model, Status
from launchid_core.filter import filtered as fl
from launchid_core.filter import kalman as km
from launchid_core.filter import servo as sv
from launchid_core.filter import states as sx
from launchid_core.filter import whiteness as wh
from launchid_core.model import OFFSETS
from launchid_core.order.table import CONSTANT, STEP
from launchid_core.status import EstimateStatus
from sim.effects import from_text
from sim.errors import InputError
from sim.flight import Flight, fly_whole
from sim.nominal import Drift, Nominal, Offsets, Wind
from sim.onboard import onboard_model

linalg = pytest.importorskip("scipy.linalg")

PERIOD = 0.01
DRIFTING = dataclasses.replace(CALM, drift=Drift(np.zeros(1), np.array([-0.03]), np.array([-0.02])))

set_step, start_segment = map(unjitted, (sv.set_step, km.start_segment))
solve_window, report_window, limit_terms = map(unjitted, (fl.solve_window, fl.report_window, fl.limit_terms))
judge_model, likelihood_of_chance = unjitted(wh.judge_model), unjitted(wh.likelihood_of_chance)


def config(nominal: Nominal = WINDY, **choices) -> Config:
    return Config(**{"window": 5.0, "formulation": "filtered", "model": onboard_model(nominal), **choices})


def with_effects(*texts: str) -> Nominal:
    """The calm nominal that knows of these effects."""
    return dataclasses.replace(CALM, effects=tuple(map(from_text, texts)))


@functools.cache
def windy_flight(seed: int) -> Flight:
    return fly_whole(WINDY, seed)


def far_off(estimate: Estimate, flight: Flight) -> float:
    """The larger error of a6 and k1 of a valid window in its own standard deviations."""
    at = 0.5 * (estimate.t_start + estimate.t_end)
    return max(abs(estimate.a6 - np.interp(at, flight.t, flight.a6)) / estimate.a6_std,
               abs(estimate.k1 - np.interp(at, flight.t, flight.k1)) / estimate.k1_std)


# ---- one step


def assert_close(values, exact, tolerance: float = 1e-10) -> None:
    """Relative to the largest entry."""
    assert np.max(np.abs(np.subtract(values, exact))) <= tolerance * np.max(np.abs(exact))


@pytest.fixture(scope="module")
def calm_parts():
    """Memory of the calm nominal's estimator."""
    cut = cut_of(config(CALM))
    return cut


@pytest.mark.parametrize("damping", [0.05, 0.3, 0.7, 1.0, 1.0 + 1e-9, 2.0, 10.0])
def test_a_step_of_the_servo_is_the_matrix_exponential(calm_parts, damping):
    """States in units of one size: double integral/h^2, integral/h, beta, beta_dot/w, command."""
    constant, work, step = copied(CONSTANT, calm_parts.fixed.belief.constant), calm_parts.work.filter, scratch(STEP, 2)
    constant.damping = damping
    for turned in np.geomspace(1e-3, 50.0, 25):
        w = constant.frequency = turned / PERIOD
        set_step(constant, w, damping, PERIOD, work, step)
        a = np.zeros((5, 5))
        a[0, 1] = a[1, 2] = 1.0
        a[2, 3], a[3] = turned, [0.0, 0.0, -turned, -2.0 * damping * turned, turned]
        exact = linalg.expm(a)
        unit = np.array([1.0, 1.0 / w, 1.0])
        assert_close(step.phi * [[1.0, w], [1.0 / w, 1.0]], exact[2:4, 2:4])
        assert_close(step.by_command * [1.0, 1.0 / w], exact[2:4, 4])
        assert_close(step.once / unit / PERIOD, exact[1, 2:])
        assert_close(step.twice / unit / PERIOD**2, exact[0, 2:])


@pytest.mark.parametrize("share", [0.01, 0.1, 1.0, 7.0, 50.0])
def test_a_step_of_a_first_order_servo_and_of_turbulence_is_their_exponential(calm_parts, share):
    constant, work, step = copied(CONSTANT, calm_parts.fixed.belief.constant), calm_parts.work.filter, scratch(STEP, 2)
    constant.frequency = constant.damping = math.nan  # not used
    h, t = PERIOD, PERIOD / share
    constant.time_constant, constant.turbulence_time = t, 3.0 * t
    set_step(constant, math.nan, math.nan, h, work, step)
    gone = -math.expm1(-share)
    assert step.h == h
    assert_close([*step.phi.ravel(), *step.by_command], [1.0 - gone, 0.0, 0.0, 0.0, gone, 0.0], 1e-14)
    assert_close(step.once, [t * gone, 0.0, h - t * gone], 1e-12)
    held = t * h - t * t * gone
    assert_close(step.twice, [held, 0.0, 0.5 * h * h - held], 1e-11)
    assert step.keep == pytest.approx(math.exp(-share / 3.0), rel=1e-15)


class Plain:
    """A Kalman filter of theta_ddot = a6 (theta + w) + k1 (beta + m) + moment, in plain numpy, begun with a sample."""

    def __init__(self, model: Model, row: np.ndarray) -> None:
        h, a6, k1 = PERIOD, model.profile_a6[0], model.profile_k1[0]
        w, zeta = model.natural_frequency, model.damping_ratio
        servo = np.zeros((5, 5))  # double integral, integral, beta, beta_dot, command
        servo[0, 1] = servo[1, 2] = servo[2, 3] = 1.0
        servo[3] = 0.0, 0.0, -w * w, -2 * zeta * w, w * w
        servo = linalg.expm(servo * h)
        f = np.eye(11)
        f[0, :2] = 1.0 + 0.5 * a6 * h * h, h + a6 * h**3 / 6.0
        f[1, :2] = a6 * f[0, 1], f[0, 0]
        f[0, 2:4], f[1, 2:4], f[2:4, 2:4] = k1 * servo[0, 2:4], k1 * servo[1, 2:4], servo[2:4, 2:4]
        push, keep = np.array([a6, a6, k1, 1.0, -a6]), math.exp(-h / model.turbulence_time)
        f[0, 4:9], f[1, 4:9], f[5, 5] = 0.5 * h * h * push, h * push, keep
        self.f, self.u = f, np.concatenate([k1 * servo[:2, 4], servo[2:4, 4], np.zeros(7)])
        pushed = np.array([0.5 * h * h, h, *np.zeros(9)])
        held = model.noise_period / h
        self.q = np.outer(self.u, self.u) * model.command_noise_std**2 * held \
            + np.outer(pushed, pushed) * model.acceleration_noise_std**2 * held
        self.q[4, 4] += model.walk**2 * h
        self.q[5, 5] += model.turbulence**2 * (1.0 - keep**2)
        self.r = np.array([model.theta_std, model.theta_dot_std, model.beta_std])**2
        self.h = np.zeros((3, 11))
        self.h[[0, 1, 2], [0, 1, 2]] = self.h[[1, 2], [9, 10]] = 1.0
        self.x = np.array([*row[1:4], *np.zeros(8)])  # state = sample - offset - noise
        one = np.array([model.wind_initial, model.turbulence, *(getattr(model, name) for name in OFFSETS)])
        a = np.zeros((11, 11))  # of noise (3), beta_dot, nuisances (7)
        a[[0, 1, 2, 3], [0, 1, 2, 3]] = 1.0
        a[4:, 4:] = np.eye(7)
        a[[1, 2], [9, 10]] = -1.0
        self.p = a @ np.diag([*self.r, 0.5**2, *one**2]) @ a.T

    def predict(self, command: float) -> None:
        self.x = self.f @ self.x + self.u * command
        self.p = self.f @ self.p @ self.f.T + self.q

    def correct(self, z: np.ndarray) -> tuple[list[float], list[float]]:
        """(innovations, their variances) of theta, theta_dot, beta in turn."""
        innovations, variances = [], []
        for h, r, value in zip(self.h, self.r, z, strict=True):
            column = self.p @ h
            e, s = value - h @ self.x, h @ column + r
            self.x, self.p = self.x + column / s * e, self.p - np.outer(column, column) / s
            innovations.append(e)
            variances.append(s)
        return innovations, variances


def windy_rows(seed: int) -> np.ndarray:
    """Samples of a flight, as the ring holds them."""
    flight = windy_flight(seed)
    return np.column_stack([flight.t, flight.theta, flight.theta_dot, flight.beta, flight.theta_ddot, flight.beta_cmd,
                            flight.gamma])


def plain_likelihood(model: Model, rows: np.ndarray, levels: np.ndarray) -> float:
    """Log-likelihood of the plain filter at these log noise levels."""
    scaled = {name: getattr(model, name) * math.exp(level) for name, level in zip(model.levels, levels, strict=True)}
    plain, total = Plain(dataclasses.replace(model, **scaled), rows[0]), 0.0
    for k, row in enumerate(rows):
        if k > 0:
            plain.predict(rows[k - 1, 5])
        for e, s in zip(*plain.correct(row[1:4]), strict=True):
            total -= 0.5 * (math.log(s) + e * e / s)
    return total


@pytest.mark.parametrize("nominal", [WINDY, CALM])
def test_score_of_the_levels_is_the_slope_of_a_plain_filters_likelihood(nominal):
    of, rows = config(nominal), windy_rows(0)[500:560]
    levels = np.array([0.1, -0.2, 0.15, 0.05, -0.3, 0.4, 0.0])  # a segment begins with the turbulence as declared
    levels = levels[:len(of.model.levels)]
    if nominal is CALM:
        rows = np.array([sample._replace(gamma=math.nan) for sample in fly_whole(CALM, 0).samples()][:40])
    cut = cut_of(of)
    state = cut.state
    state.filter.level[...] = levels
    for row in rows:
        take(cut, row)
        state.acc.counts.rows = 0
    step = 1e-4
    slopes = [(plain_likelihood(of.model, rows, levels + step * unit)
               - plain_likelihood(of.model, rows, levels - step * unit)) / (2 * step) for unit in np.eye(len(levels))]
    assert np.allclose(state.acc.score, slopes, rtol=2e-4, atol=2e-3)


def test_after_a_gap_the_walk_has_gone_on_and_the_offsets_are_as_declared():
    cut = cut_of(config())
    belief, fil, model = cut.fixed.belief, cut.state.filter, onboard_model(WINDY)
    for t in (3.0, 40.0):
        fil.p[...], fil.sx[...] = 9.0, 9.0
        start_segment(belief, fil, t, 0.1, 0.2, 0.3, math.nan)
        walk = model.wind_initial**2 + model.walk**2 * (t - 3.0)
        offsets = [getattr(model, name)**2 for name in OFFSETS]
        assert np.diag(fil.p)[4:] == pytest.approx([walk, model.turbulence**2, *offsets], rel=1e-12)
        assert fil.p[[0, 1, 2], [8, 9, 10]] == pytest.approx([0.0, *np.negative(offsets[3:])])
        assert fil.p[0, 0] == pytest.approx(model.theta_std**2)  # theta as measured: its bias is an acceleration
        assert not fil.x[3:].any() and not fil.sx.any() and (fil.p == fil.p.T).all()
    start_segment(belief, fil, 41.0, 0.1, math.nan, 0.3, math.nan)
    assert fil.p[1].tolist() == [0.0, km.UNKNOWN_RATE_STD**2, *np.zeros(9)] and fil.x[1] == 0.0


def test_the_filter_in_wind_is_a_plain_kalman_filter():
    """200 samples at p_bar = 0 and the declared levels; rows carry e/sqrt(S), x and P what S and the gain make."""
    table = windy_rows(0)[2000:2200]
    of = config(noise="declared")
    cut = cut_of(of)
    state, fil = cut.state, cut.state.filter
    plain = Plain(of.model, table[0])
    for k, row in enumerate(table):
        if k > 0:
            plain.predict(table[k - 1, 5])
        e, s = plain.correct(row[1:4])
        take(cut, row)
        assert state.acc.counts.rows == 3
        state.acc.counts.rows = 0
        assert np.allclose(cut.apart["rows"][-1, :3], e / np.sqrt(s), rtol=1e-9, atol=1e-9)
        column = plain.p @ plain.h[2] * s[2] / plain.r[2]  # before the update: P h (1 - (S - r)/S) = P+ h
        assert np.allclose(cut.work.filter.column, column, rtol=1e-9, atol=1e-9 * np.max(np.abs(column)))
        scale = np.sqrt(np.diag(plain.p))
        assert np.max(np.abs(fil.x - plain.x) / scale) < 1e-9
        assert np.max(np.abs(fil.p - plain.p) / np.outer(scale, scale)) < 1e-9
    assert not fil.p_bar.any() and not fil.level.any()


def test_the_covariance_stays_one_for_a_whole_flight():
    """An asymmetry would grow as the vehicle does, e^(2 1.4 t), and the filter would lose its sensors."""
    estimator = Estimator(config())
    p = estimator._parts.state.filter.p
    for k, sample in enumerate(windy_flight(0).samples()):
        estimator.update(sample)
        if k % 250 == 249:
            scale = np.sqrt(np.diag(p))
            correlation = p / np.outer(scale, scale)
            assert np.max(np.abs(correlation - correlation.T)) < 1e-12
            assert np.linalg.eigvalsh(correlation)[0] > 0.0
    assert k == 6999 and (estimator.counts["OUTLIER"], estimator.counts["RESTART"]) == (0, 0)


# ---- the wind's levels


def test_in_calm_air_the_wind_s_levels_fall_and_in_twice_the_declared_they_rise():
    """A plain filter's likelihood of this flight excludes a thirtieth of the declared levels by 27 nats at its end."""
    declared = dataclasses.replace(CALM, wind=Wind(walk=0.005, turbulence=0.005),
                                   offsets=Offsets(thrust_misalignment=0.004, attitude_bias=0.005))
    twice = dataclasses.replace(declared, wind=Wind(walk=0.01, turbulence=0.01))
    for flown, low, high in ((CALM, 0.0, 0.045), (twice, 1.5, 2.7)):
        estimator = fed(Estimator(config(declared, window=1.0)), fly_whole(flown, 3).samples())
        for name in ("walk", "turbulence"):
            assert low < estimator.noise_levels[name] < high, (name, estimator.noise_levels)


# ---- nothing where there is nothing


def test_a_calm_model_has_no_nuisance_and_no_wind():
    of = config(CALM)
    assert of.model.nuisances == () and of.model.levels == ("theta_std", "theta_dot_std", "beta_std",
                                                             "command_noise_std", "acceleration_noise_std")
    cut = cut_of(of)
    assert cut.fixed.belief.constant.held == cut.fixed.belief.constant.airy == 0.0
    assert len(cut.state.filter.x) == 4 and cut.fixed.belief.partner.tolist() == [sx.ABSENT] * 3
    zero = dataclasses.replace(CALM, wind=Wind(walk=0.0, turbulence=0.0), offsets=Offsets())
    assert config(zero).model == of.model
    estimates, _ = run(of, list(fly_whole(CALM, 0).samples())[:1100])
    assert len(estimates) == 2
    for estimate in estimates:
        assert math.isnan(estimate.wind) and math.isnan(estimate.wind_std) and dict(estimate.offsets) == {}


def test_a_flight_path_of_zero_changes_nothing():
    samples = list(fly_whole(CALM, 3).samples())[:3000]
    without, _ = run(config(CALM), samples)
    given, _ = run(config(CALM), [sample._replace(gamma=0.0) for sample in samples])
    assert len(given) == 6
    for one, two in zip(without, given, strict=True):
        assert abs(one.a6 - two.a6) < 1e-12 and abs(one.k1 - two.k1) < 1e-12
        assert abs(one.tracked.a6 - two.tracked.a6) < 1e-12 and abs(one.tracked.k1 - two.tracked.k1) < 1e-12


# ---- drift


def test_a_drift_is_identified_with_gamma_or_a_model_of_it_and_not_without():
    flight = fly_whole(DRIFTING, 0)
    samples = list(flight.samples())
    unknown = [sample._replace(gamma=math.nan) for sample in samples]
    assert np.max(np.abs(flight.true_gamma)) > 0.1
    for nominal, seen in ((CALM, samples), (DRIFTING, unknown), (DRIFTING, samples)):
        estimates, _ = run(config(nominal), seen)
        last = estimates[-1].tracked
        assert all(estimate.valid and far_off(estimate, flight) < 4.0 for estimate in estimates)
        assert abs(last.a6 - 2.0) < 3.0 * last.a6_std and abs(last.k1 + 7.0) < 3.0 * last.k1_std
        assert last.a6_std < 0.1
    estimates, _ = run(config(CALM), unknown)
    assert not estimates[-1].tracked.valid
    assert sum(estimate.status.name == "MODEL" or far_off(estimate, flight) > 4.0 for estimate in estimates) >= 4


# ---- wind and offsets


def test_wind_and_offsets_are_what_flew():
    flight = windy_flight(0)
    estimates, _ = run(config(), flight.samples())
    assert len(estimates) == 14 and all(estimate.valid for estimate in estimates)
    for estimate in estimates:
        assert far_off(estimate, flight) < 4.0
        wind = np.interp(estimate.t_end, flight.t, flight.wind)
        assert abs(estimate.wind - wind) < 4.0 * estimate.wind_std
        assert set(estimate.offsets) == set(OFFSETS)
        for name, offset in estimate.offsets.items():
            assert abs(offset.value - flight.offsets[name]) < 4.0 * offset.std, name
    last = estimates[-1]
    assert last.wind_std < 0.03  # of 0.05 at first, and a walk of 0.042 in 70 s
    assert last.offsets["gyro_bias"].std < 0.5e-3  # of 1e-3


# ---- effects that a nominal knows of


@pytest.mark.parametrize("text", [
    "actuator_bias:angle=0.01", "gyro_bias:rate=0.005", "gyro_scale:scale=1.2", "nozzle_sensor_bias:angle=0.01",
    "attitude_bias:angle=0.01", "thrust_misalignment:angle=0.01", "steady_wind:angle=0.03",
    "gust:angle=0.05,time=20,duration=6", "control_loss:time=30.05,fraction=0.3", "actuator_gain:scale=0.7",
    "aero_damping:coefficient=1.5"])
def test_a_known_effect_is_flown_and_believed(text):
    """The control: who does not know of it errs, or says that the model is wrong, or finds a sudden change."""
    nominal = with_effects(text)
    flight = fly_whole(nominal, 2)
    estimates, estimator = run(config(nominal), flight.samples())
    assert len(estimates) == 14 and estimator.changes() == ()
    assert all(estimate.valid and far_off(estimate, flight) < 4.0 for estimate in estimates)
    unaware, estimator = run(config(CALM), flight.samples())
    assert any(not estimate.valid or far_off(estimate, flight) > 4.0 for estimate in unaware) or estimator.changes()


def test_a_first_order_servo_is_flown_and_believed():
    """The control: a servo twice as quick, believed of the same flight, needs louder commands (beta is measured)."""
    assert CALM.actuator is not None
    slow, quick = (dataclasses.replace(CALM, actuator=dataclasses.replace(
        CALM.actuator, natural_frequency=math.nan, damping_ratio=math.nan, time_constant=t)) for t in (0.04, 0.02))
    flight = fly_whole(slow, 2)
    estimates, estimator = run(config(slow), flight.samples())
    assert len(estimates) == 14
    assert all(estimate.valid and far_off(estimate, flight) < 4.0 for estimate in estimates)
    assert estimator.noise_levels["command_noise_std"] == pytest.approx(1.0, abs=0.1)
    assert estimator.noise_levels["beta_std"] == pytest.approx(1.0, abs=0.05)
    _, mistaken = run(config(quick), flight.samples())
    assert mistaken.noise_levels["command_noise_std"] > 1.5 and mistaken.noise_levels["beta_std"] > 1.2


def test_an_effect_that_the_filter_cannot_hold_is_one_error_naming_it():
    with pytest.raises(InputError, match="friction") as caught:
        onboard_model(with_effects("gyro_bias:rate=0.005", "friction:coefficient=0.01"))
    assert len(str(caught.value).splitlines()) == 1


# ---- the check of the model


def test_a_disturbance_that_is_not_declared_is_the_models_fault_and_no_change():
    flight = fly_whole(CALM, 0, effects=[from_text("periodic_disturbance:amplitude=0.01,frequency=5")])
    estimator, estimates = Estimator(config(CALM)), []
    state, raised = estimator._parts.state, 0
    for sample in flight.samples():
        before = state.check.raised, state.watch.counts.events
        if estimator.update(sample) == Status.WINDOW_COMPLETE:
            estimates.append(estimator.estimate())
        if before[0] == 1 and state.check.raised == 1:
            assert state.watch.counts.events == before[1]
            raised += 1
    assert raised > 6000
    assert [estimate.status.name for estimate in estimates].count("MODEL") >= 12
    for estimate in estimates[1:]:
        assert not estimate.tracked.valid and math.isnan(estimate.tracked.a6)
        assert estimate.status.name != "MODEL" or (not estimate.valid and math.isnan(estimate.a6))


def test_a_strong_gust_is_no_change_of_the_vehicle():
    flight = fly_whole(CALM, 0, effects=[from_text("gust:angle=0.05,time=20,duration=6")])
    estimates, _ = run(config(CALM, window=1.0), flight.samples())
    assert max(far_off(estimate, flight) for estimate in estimates if estimate.valid) < 5.0


def test_the_model_is_believed_again_within_20_s_of_a_gust():
    flight = fly_whole(CALM, 0, effects=[from_text("gust:angle=0.02,time=20,duration=6")])
    estimates, _ = run(config(CALM), flight.samples())
    assert estimates[-1].valid and estimates[-1].tracked.valid


def blocks_fed(block, level, blocks, statistic):
    """Blocks of ten measurements a channel, with these normalised sums; returns how often it was raised."""
    check, raised = block[0].state.check, 0
    for k in range(blocks.shape[0]):
        for c in range(3):
            check.innovation[c] = blocks[k, c] * math.sqrt(10.0)
            check.seen[c] = 10
        wh.queue_block(check, level, np.zeros(2), block[0].state.bank.total)
        before = check.raised
        if check.waiting >= sx.CHANGE_BLOCKS:
            wh.take_block(check, 0.1)
        wh.judge_model(check, level, 0, 0.1 * k)
        raised += int(check.raised == 1 and before == 0)
        statistic[k] = check.statistic
    return raised


feed_blocks = numba.njit(error_model="numpy")(blocks_fed)


def checked(blocks: np.ndarray):
    """(How often raised, the statistic after each block) of a state as before the first sample, a6 and k1 known."""
    cut, statistic = cut_of(config(CALM)), np.zeros(len(blocks))
    for number in cut.state.bank.total:
        number[...] = 0.0
    return feed_blocks(cut.memory.seen, np.zeros(5), blocks, statistic), statistic


def test_white_innovations_are_as_the_statistic_says_and_raise_nothing_in_two_hours():
    """The statistic's standard deviation is 16.3; over 2 h at a memory of 10 s, some 360 values are independent."""
    raised, statistic = checked(np.random.default_rng(1).standard_normal((72000, 3)))
    settled = statistic[1000:]
    assert raised == 0
    assert np.mean(settled) == pytest.approx(wh.MEAN_STATISTIC, abs=4.0 * 16.3 / math.sqrt(360))
    assert np.std(settled) == pytest.approx(16.3, rel=0.25)
    assert np.mean(settled > wh.BELIEVED) == pytest.approx(0.08, abs=0.05)


def test_a_noise_level_beyond_ten_times_is_the_models_fault_but_not_the_winds():
    cut = cut_of(config())
    check, level = cut.state.check, np.zeros(7)
    for k in range(7):
        for value, raised in ((0.99 * wh.HIGHEST_LEVEL, 0), (1.01 * wh.HIGHEST_LEVEL, int(k < 5)), (0.0, 0)):
            level[k] = value
            before = check.raised
            assert judge_model(check, level, 0, 0.0) == (before == 1 and raised == 0)
            assert check.raised == raised


def test_a_quiet_first_window_does_not_take_its_guesses_of_the_offsets_for_information():
    """The transient that the misalignment makes tells of a6 before the first manoeuvre of `constant`."""
    declared = dataclasses.replace(CALM, offsets=Offsets(thrust_misalignment=0.004, attitude_bias=0.005))
    far = []
    for seed in range(24):
        a6_factor, k1_factor = 1.0 + np.random.default_rng((61, seed)).uniform(-0.25, 0.25, 2)
        flight = fly_whole(declared, seed, a6_factor=a6_factor, k1_factor=k1_factor)
        first, *_ = run(config(declared), list(flight.samples())[:505])[0]
        assert first.valid
        far += [[(first.a6 - flight.a6[0]) / first.a6_std, (first.tracked.a6 - flight.a6[0]) / first.tracked.a6_std]]
    root = np.sqrt(np.mean(np.square(far), axis=0))
    assert 0.65 < root[0] < 1.4 and root[1] < 1.4 and np.max(np.abs(far)) < 4.0


def test_the_attitude_s_bias_is_told_where_the_air_is_still():
    """A steady attitude bias is all that bends the trim beside a misalignment of 0."""
    declared = dataclasses.replace(CALM, offsets=Offsets(attitude_bias=0.005), a6_drift=0.0, k1_drift=0.0)
    flight = fly_whole(declared, 4, a6_factor=1.2)
    value, std = run(config(declared), list(flight.samples()))[0][-1].offsets["attitude_bias"]
    assert std < 0.1 * 0.005 and abs(value - flight.offsets["attitude_bias"]) < 4.0 * std


def test_the_p_value_is_that_of_a_chi_square():
    stats = pytest.importorskip("scipy.stats")
    cut = cut_of(config(CALM))
    check = cut.state.check
    for statistic in (30.0, 63.0, 90.0, 130.0):
        check.statistic = statistic
        exact = stats.chi2.sf(statistic / wh.MEAN_STATISTIC * wh.FREEDOM, wh.FREEDOM)
        assert likelihood_of_chance(check) == pytest.approx(exact, rel=0.05, abs=1e-4)


# ---- a6 and k1 apart


def solved(correlation: float, std: float):
    """Parts of an estimator whose window knows both deviations to `std`, 0.1 and -0.2, correlated so."""
    cut = cut_of(config(CALM))
    acc = cut.state.acc
    covariance = std**2 * np.array([[1.0, correlation], [correlation, 1.0]])
    root = np.linalg.cholesky(np.linalg.inv(covariance)).T  # R'R = information
    acc.window[...] = 0.0
    acc.window[4:6, 4:6], acc.window[4:6, -1] = root, root @ [0.1, -0.2]
    assert solve_window(cut.fixed.belief, acc, cut.work.acc, cut.state.active, 0.0) == 0.0
    return cut


@pytest.mark.parametrize(("correlation", "std", "status"), [
    (0.999, 0.5, "SEPARATION"), (-0.999, 0.5, "SEPARATION"), (0.98, 0.5, "OK"), (0.999, 0.2, "OK"),
    (0.999, 1.1, "LOW_INFORMATION"), (0.0, 1.1, "LOW_INFORMATION")])
def test_a_window_that_cannot_tell_a6_from_k1_says_so(correlation, std, status):
    cut = solved(correlation, std)
    work, belief = cut.work.acc, cut.fixed.belief
    assert np.abs(work.deviation) == pytest.approx([std, std, abs(correlation)], rel=1e-9)
    assert work.coefficient == pytest.approx([0.1, -0.2], rel=1e-9)
    found = report_window(belief, cut.apart["profile"], cut.state, work, 2.5)
    assert EstimateStatus(found).name == status
    out = cut.state.outcome
    assert (out.a6_bound, out.k1_bound) == pytest.approx((2.0 * std, 7.0 * std))
    if status == "OK":
        assert (out.a6, out.k1) == pytest.approx((2.2, -5.6))
    cut.state.check.in_window = 1
    contradicted = EstimateStatus(report_window(belief, cut.apart["profile"], cut.state, work, 2.5)).name
    assert contradicted == ("LOW_INFORMATION" if status == "LOW_INFORMATION" else "MODEL")


def test_the_correlation_is_that_of_the_errors():
    errors, said = [], []
    for seed in range(6):
        for estimate in run(config(CALM), fly_whole(CALM, seed).samples())[0]:
            errors.append([(estimate.a6 - 2.0) / estimate.a6_std, (estimate.k1 + 7.0) / estimate.k1_std])
            said.append(estimate.a6_k1_corr)
    assert np.mean(said) == pytest.approx(np.corrcoef(np.transpose(errors))[0, 1], abs=0.1)


# ---- what is absent


def test_a_limit_of_an_absent_term_is_the_95_percent_one_of_least_squares():
    """The reference is the term added alone to the active ones, by numpy; the quantile is the standard library's."""
    cut = cut_of(config(CALM, library="quadratic"))
    acc, active, out = cut.state.acc, cut.state.active, cut.state.outcome
    n, q = len(acc.psi), len(active)
    noise = np.random.default_rng(5).standard_normal(acc.window.shape)
    acc.window[...] = np.triu(noise + 4.0 * np.eye(len(noise)))
    active[:] = 0
    active[[cut.memory.size.theta, cut.memory.size.beta]] = 1
    out.status = 0
    limit_terms((cut.memory.parts,), cut.apart["profile"])
    kept = [*range(n), *(n + np.flatnonzero(active))]
    for term in np.flatnonzero(active == 0):
        table = acc.window[:, [*kept, n + term]]
        value = np.linalg.lstsq(table, acc.window[:, -1])[0][-1]
        std = math.sqrt(np.linalg.inv(table.T @ table)[-1, -1])
        assert out.absent[term] == pytest.approx(abs(value) + NormalDist().inv_cdf(0.975) * std, rel=1e-4), term
    assert len(kept) == n + 2 and q > 2
