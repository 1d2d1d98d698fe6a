"""launchid diagnose in a world that is not calm: declared and undeclared wind, a measured flight path, other loops,
stamps that jitter, channels that are missing, rows that are bad; and what no weather may do to a verdict."""

import dataclasses
import functools
import math
from types import SimpleNamespace

import numpy as np
import pytest
from test_diagnosis import WHOLE, changed, log_of

from launchid.diagnosis.causes import SOUGHT
from launchid.diagnosis.controller.command import record
from launchid.diagnosis.data.record import Record
from launchid.diagnosis.data.world import MOMENT, SLOW_MOMENT, TURBULENCE, WALK, WIND, Source, World
from launchid.diagnosis.judge.absorbed import Absorbing
from launchid.diagnosis.model.level_fit import fit_levels
from launchid.diagnosis.model.noise import Refilter, bounds, declared, dynamics, first_filter, run_filter
from launchid.diagnosis.model.nuisance import Problem
from launchid.diagnosis.model.point import Point, innovations, prediction_errors
from launchid.diagnosis.model.predictor import push
from launchid.diagnosis.model.weighing import Weighing
from launchid.diagnosis.report.answer import report
from launchid.diagnosis.search.profile import as_simulated
from launchid.diagnosis.search.scan import Projector
from launchid.diagnosis.search.selection import _ranking
from launchid.diagnosis.verdict import diagnose
from launchid.log.detect import check
from launchid.log.log import OPTIONAL, REQUIRED
from launchid.sums import square
from sim.effects import from_text
from sim.flight import fly_whole
from sim.nominal import Drift, Forecast, Offsets, Wind

NOMINAL = dataclasses.replace(WHOLE, simulation=dataclasses.replace(WHOLE.simulation, duration=30.0))
FEW = tuple(each for each in SOUGHT if each.cause in (
    "control_effectiveness", "aero_damping", "steady_wind", "actuator_delay", "gyro_bias"))  # of every place one
WINDY = dataclasses.replace(NOMINAL, wind=Wind(walk=0.002, turbulence=0.005, turbulence_time=1.0))
DRIFT = Drift(np.zeros(1), np.array([-0.03]), np.array([-0.02]))
LAG = dataclasses.replace(NOMINAL, actuator=dataclasses.replace(
    NOMINAL.actuator, natural_frequency=math.nan, damping_ratio=math.nan, time_constant=0.04))
RATE = dataclasses.replace(NOMINAL, controller=dataclasses.replace(
    NOMINAL.controller, law="rate", kp=0.9, ki=1.1, kd=0.0, derivative_time_constant=0.0))
OPEN = dataclasses.replace(NOMINAL, controller=None)   # the controller is not known
LATE = "actuator_delay:delay=0.02"


@functools.cache
def flown(nominal, *effects, seed=1, period=None):
    """The log of a flight; shared, so nobody changes it."""
    return log_of(fly_whole(nominal, seed, period=period, effects=[from_text(each) for each in effects]))


def judged(log, nominal, hypotheses=FEW):
    return report(diagnose(log, nominal, hypotheses=hypotheses))


def names(result):
    return [cause["cause"] for cause in result["causes"]]


def without(log, *columns):
    """The log with these columns not there."""
    none = {name: np.full(len(log.t), math.nan) for name in columns}
    return dataclasses.replace(log, columns=tuple(each for each in log.columns if each not in columns), **none)


def rows(log, kept):
    """The log with these rows."""
    return dataclasses.replace(log, **{name: getattr(log, name)[kept] for name in REQUIRED + OPTIONAL})


def has_size(cause, parameter, truth, share):
    """Whether a size is within a share of the truth, and within five of its own standard deviations."""
    value = cause["parameters"][parameter]
    return abs(value["value"] - truth) < min(share * abs(truth), 5.0 * value["std"])


def on_grid(log, nominal) -> Record:
    return record(log, nominal, check(log, nominal))


# ---- the world's states in the model

UNSURE = dataclasses.replace(WINDY, offsets=Offsets(0.01, 0.005, 0.004, 0.003, 0.02))


@pytest.mark.parametrize("period", [0.01, 0.005])
def test_the_predictor_and_the_linear_filter_carry_the_same_world(period):
    """One likelihood, whether the innovations are of a filter at these levels or at quite others: rigid body, servo and
    world are linear, so what the simulator's own steps make of the states is what the filter's matrices say."""
    nominal = dataclasses.replace(UNSURE, simulation=dataclasses.replace(UNSURE.simulation, duration=8.0))
    r = on_grid(flown(nominal, period=period), nominal)
    assert len(r.world.sources) == 8 and len({each.entry for each in r.world.sources}) == 6
    dyn, levels = dynamics(r, Point()), declared(r)
    found = []
    for scale in (1.0, np.array([0.3, 3.0, 0.5, 2.0, 5.0, 4.0, 0.2, 3.0])):
        base = first_filter(r, scale * levels)
        e, _, stayed = innovations(r, base, Point())
        assert stayed
        found.append(run_filter(r, dyn, levels, e, base).log_likelihood)
    assert found[0] == pytest.approx(found[1], abs=0.1)
    calm = levels.copy()
    calm[5:] *= 0.2
    assert found[0] > Refilter(r, dyn, e, base).log_likelihood(calm) + 3.0   # and it is the world that tells


@pytest.mark.parametrize("period", [0.01, 0.005])
def test_predictions_are_off_by_what_the_noise_gives_them(period):
    """The flights are clean, in declared wind, predicted over 0.5 s: the mean square of the errors over their variance
    is 1."""
    ratios = []
    for seed in (1, 2):
        log = flown(dataclasses.replace(UNSURE, simulation=dataclasses.replace(WINDY.simulation, duration=20.0)),
                    seed=seed, period=period)
        r = on_grid(log, UNSURE)
        first = first_filter(r, declared(r))
        spacing, ahead = round(0.125 / period), round(0.5 / period)
        errors = prediction_errors(r, first, Point(), (0.5,), 0.125)[8:, 0]
        refilter = Refilter(r, dynamics(r, Point()), r.z)
        variances = refilter.horizon_variances(declared(r), spacing, ahead)[8:]
        ratios.append(np.nanmean(errors**2 / variances, axis=0))
    mean = np.mean(ratios, axis=0)
    assert mean == pytest.approx(1.0, rel=0.35), mean


def test_what_the_nominal_declares_is_in_the_world_and_always_a_slow_moment():
    def sources(nominal):
        return [each.name for each in on_grid(flown(NOMINAL), nominal).world.sources]

    assert sources(NOMINAL) == [SLOW_MOMENT]
    assert sources(WINDY) == [SLOW_MOMENT, WALK, TURBULENCE]
    assert sources(dataclasses.replace(NOMINAL, wind=Wind(turbulence=0.005))) == [SLOW_MOMENT, WALK, TURBULENCE]
    assert sources(dataclasses.replace(NOMINAL, offsets=Offsets(gyro_bias=0.01))) == [SLOW_MOMENT, "gyro_bias offset"]


def test_noise_may_be_bounded_declared_or_free():
    """The wind's levels up to twice the declared, the others within 0.3..3; the acceleration has no upper end."""
    r = on_grid(flown(NOMINAL), WINDY)
    least, most = bounds(r)
    assert least.tolist() == [0.3] * 5 + [1.0, 0.05, 0.05]
    assert most.tolist() == [3.0] * 4 + [1e3, 1.0, 2.0, 2.0]
    least, most = bounds(dataclasses.replace(r, noise="declared"))
    assert np.all(least[:6] == 1.0) and np.all(most[:6] == 1.0)
    least, most = bounds(dataclasses.replace(r, noise="free"))
    assert np.all(least[:5] == 1e-3) and np.all(most[:5] == 1e3) and np.all(most[6:] == 1e3)
    assert least[5] == most[5] == 1.0   # the slow moment is what it is


# ---- wind


def test_declared_wind_is_consistent():
    result = judged(flown(WINDY, seed=3), WINDY)
    assert (result["verdict"], result["weather"]) == ("consistent", None), result["doubts"]
    assert all(0.5 <= result["noise"][name]["factor"] <= 2.0 for name in (TURBULENCE, WALK))


def test_wind_that_nobody_declared_is_named_as_such():
    gusty = dataclasses.replace(NOMINAL, wind=Wind(turbulence=0.01, turbulence_time=1.0, initial=0.0))
    result = judged(flown(gusty, seed=3), NOMINAL)
    assert result["verdict"] in ("explained", "dominant") and result["where"] == "environment", result["doubts"]
    cause = result["causes"][0]
    assert cause["cause"] in (TURBULENCE, WALK)
    assert {cause["cause"], *cause["indistinguishable_from"]} & {TURBULENCE}
    if cause["cause"] == TURBULENCE:   # half a minute tells how fast it changes, (2/T)^1/2 of the level, not T itself
        level, time = (cause["parameters"][name]["value"] for name in ("level", "time_constant"))
        assert level * math.sqrt(2.0 / time) == pytest.approx(0.01 * math.sqrt(2.0), rel=0.25)
    assert result["weather"]["source"] == cause["cause"] and result["gain"]["nats"] > 0.0


def test_a_cause_in_declared_wind_is_named_with_its_size():
    result = judged(flown(WINDY, LATE, seed=4), WINDY)
    assert (result["verdict"], names(result)) == ("explained", ["actuator_delay"]), result["doubts"]
    assert has_size(result["causes"][0], "delay", 0.02, 0.15)


SLOW = tuple(each for each in SOUGHT if each.cause in (
    "lateral_drift", "aero_damping", "attitude_bias", "thrust_misalignment", "steady_wind", "moment_step"))


@pytest.mark.parametrize("end", [0.01, pytest.param(-0.03, marks=pytest.mark.campaign)])
def test_a_moment_that_grows_from_the_start_is_no_flight_path_that_drifts(end):
    """Two forces on the path together make any moment that grows: so does a wind [rad] that nobody declared."""
    grows = Forecast(np.array([0.0, WHOLE.simulation.duration]), np.array([0.0, end]))
    log = flown(dataclasses.replace(WHOLE, wind=Wind(profile=grows)))
    made = diagnose(log, WHOLE, hypotheses=SLOW)
    assert (made.verdict, made.where) == ("unexplained", "plant")
    assert any("straight line in time" in doubt for doubt in made.doubts)


def test_a_flight_path_that_drifts_is_no_moment_that_grows():
    made = diagnose(flown(NOMINAL, "lateral_drift:z_alpha=0.05,z_beta=0.03"), NOMINAL, hypotheses=SLOW)
    assert (made.verdict, [cause.cause for cause in made.causes]) == ("explained", ["lateral_drift"])


# ---- the flight path


@pytest.mark.parametrize("z_alpha", [-0.1, 0.05])
def test_what_is_left_of_a_wind_that_the_path_turns_with(z_alpha):
    """w - gamma of gamma' = z_alpha (w - gamma), w constant, in small steps."""
    walk = Source(WALK, WIND, 0.002, 0.05)
    gamma, step = 0.0, 1e-4
    for _ in range(round(2.0 / step)):
        gamma += step * z_alpha * (1.0 - gamma)
    assert walk.keep(2.0, z_alpha) == pytest.approx(1.0 - gamma, rel=1e-4)
    assert walk.keep(2.0) == 1.0 and walk.fresh(2.0) == 2.0
    for other in (Source(TURBULENCE, WIND, 0.005, 0.005, 1.0), Source(SLOW_MOMENT, MOMENT, 0.1, 0.1, 20.0)):
        assert other.keep(2.0, z_alpha) == other.keep(2.0)
    table = World((walk,)).table(2.0, z_alpha)
    assert table.tolist() == [[WIND, walk.keep(2.0, z_alpha)]]


@pytest.mark.parametrize(("z_alpha", "z_beta", "seed"), [
    (-0.09, 0.0, 1), pytest.param(0.06, 0.0, 2, marks=pytest.mark.campaign),
    pytest.param(-0.03, -0.1, 3, marks=pytest.mark.campaign)])
def test_a_flight_path_that_drifts_turns_with_the_wind(z_alpha, z_beta, seed):
    """The drift's numbers in declared wind are within three of their standard deviations, and it is no wind."""
    whole = dataclasses.replace(WHOLE, wind=WINDY.wind)
    effect = f"lateral_drift:z_alpha={z_alpha},z_beta={z_beta}"
    result = judged(flown(whole, effect, seed=seed), whole, SLOW)
    assert (result["verdict"], names(result)) == ("explained", ["lateral_drift"]), result["doubts"]
    found = result["causes"][0]["parameters"]
    for name, true in (("z_alpha", z_alpha), ("z_beta", z_beta)):
        assert abs(found[name]["value"] - true) < 3.0 * found[name]["std"], found


def test_a_measured_flight_path_is_known_wind():
    """A flight that drifts by much is, with its column, consistent under a nominal that does not know of the drift."""
    drifting = dataclasses.replace(NOMINAL, drift=DRIFT)
    log = flown(drifting, seed=5)
    r = on_grid(log, NOMINAL)
    assert r.path_is_known
    at = np.round(r.t / r.step).astype(int)
    assert r.wind[at] == pytest.approx(-log.gamma, abs=1e-12)
    assert judged(log, NOMINAL)["verdict"] == "consistent"
    assert judged(without(log, "gamma"), NOMINAL)["verdict"] != "consistent"


def test_a_forecast_and_a_measured_flight_path_add_up():
    log = flown(dataclasses.replace(NOMINAL, drift=DRIFT), seed=5)
    forecast = Wind(profile=Forecast(np.array([0.0, 30.0]), np.array([0.01, 0.04])))
    r = on_grid(log, dataclasses.replace(NOMINAL, wind=forecast))
    at = np.round(r.t / r.step).astype(int)
    assert r.wind[at] == pytest.approx(0.01 + 0.001 * r.t - log.gamma, abs=1e-9)


# ---- other loops


def test_a_first_order_servo_is_diagnosed():
    result = judged(flown(LAG, "gyro_bias:rate=0.005", seed=6), LAG)
    assert (result["verdict"], names(result)) == ("explained", ["gyro_bias"]), result["doubts"]
    assert has_size(result["causes"][0], "rate", 0.005, 0.1)


def test_a_rate_law_is_diagnosed():
    """The law's command is the nominal's own."""
    result = judged(flown(RATE, LATE, seed=6), RATE)
    assert (result["verdict"], names(result)) == ("explained", ["actuator_delay"]), result["doubts"]
    assert has_size(result["causes"][0], "delay", 0.02, 0.1) and result["controller"]["mismatch"] == "none"


# ---- what was measured


@functools.cache
def jittered(*effects):
    """A log at 188 Hz whose stamps, the true ones, are off their places by up to a fifth of a period."""
    log = flown(NOMINAL, *effects, period=0.001)
    rng = np.random.default_rng(5)
    t = (np.arange(math.floor(188 * (log.t[-1] - 0.01))) + rng.uniform(-0.2, 0.2)) / 188.0
    t += rng.uniform(-0.2, 0.2, len(t)) / 188.0
    return rows(log, np.unique(np.clip(np.round(t / 0.001).astype(int), 0, len(log.t) - 1)))


def test_stamps_that_jitter_are_the_true_ones():
    log = jittered("actuator_delay:delay=0.01")
    r = on_grid(log, NOMINAL)
    places = r.t[np.isfinite(r.z[:, 0])]   # the grid may have some more, where nothing was measured
    assert r.fine > 1 and np.max(np.abs(places - log.t)) < r.step
    result = judged(log, NOMINAL, tuple(h for h in FEW if h.where != "environment"))
    assert (result["verdict"], names(result)) == ("explained", ["actuator_delay"]), result["doubts"]
    assert has_size(result["causes"][0], "delay", 0.01, 0.15)


@pytest.mark.parametrize("scale", [1.002, pytest.param(0.997, marks=pytest.mark.campaign)])
def test_stamps_of_another_clock_are_no_late_actuator_where_the_commands_keep_to_the_rows(scale):
    """Two rows a command all along: the clock of rows and controller is one, and off by 0.2 %."""
    log = flown(NOMINAL, period=0.005)
    made = diagnose(dataclasses.replace(log, t=scale * log.t), NOMINAL, hypotheses=FEW)
    assert (made.verdict, made.doubts) == ("consistent", ())


@pytest.mark.parametrize("missing", [("theta", "beta", "theta_ref"), pytest.param(
    ("beta", "theta_ref"), marks=pytest.mark.campaign)])
def test_gyro_and_command_alone_name_a_late_actuator(missing):
    """t, theta_dot, beta_cmd; and with theta."""
    result = judged(without(flown(NOMINAL, LATE), *missing), OPEN)
    assert result["verdict"] in ("explained", "dominant") and names(result) == ["actuator_delay"], result["doubts"]
    assert has_size(result["causes"][0], "delay", 0.02, 0.15)


def test_a_spike_and_missing_rows_change_no_verdict_and_are_said():
    """One in 7,000 rows, and 24 that are missing."""
    whole = flown(WHOLE, "gyro_bias:rate=0.003", seed=2)

    def spiked(theta):
        theta[len(theta) // 2] += 0.3
        return theta

    kept = np.ones(len(whole.t), bool)
    kept[np.random.default_rng(0).choice(np.arange(200, len(kept) - 200), 24, replace=False)] = False
    one = tuple(h for h in FEW if h.cause in ("gyro_bias", "control_effectiveness"))
    result = judged(rows(changed(whole, theta=spiked), kept), WHOLE, one)
    assert (result["verdict"], names(result)) == ("explained", ["gyro_bias"]), result["doubts"]
    assert has_size(result["causes"][0], "rate", 0.003, 0.1)
    assert {fault["kind"] for fault in result["data"]["faults"]} == {"spike", "stamps"}
    assert sum(fault["rows"] for fault in result["data"]["faults"]) == 25


# ---- laws


@pytest.mark.parametrize("effect", ["control_effectiveness:scale=0.7", pytest.param(
    "slosh:coupling=0.3,frequency=4", marks=pytest.mark.campaign)])
def test_a_model_with_a_cause_more_is_at_least_as_likely(effect):
    """The law holds for the true cause and all others."""
    base = as_simulated(on_grid(flown(NOMINAL, effect), NOMINAL))
    found = _ranking(base.fit.record, base, [each for each in SOUGHT if not each.is_line])
    assert found
    for model, _ in found:
        assert model.log_likelihood > base.log_likelihood - 0.1, model.causes[-1].hypothesis.cause


@pytest.mark.parametrize("place", ["", pytest.param("actuator", marks=pytest.mark.campaign)])
def test_input_of_another_time_names_no_cause_of_input_or_actuator(place):
    """A placebo: nozzle and command shifted circularly by 40 % of the log have nothing to do with its motion."""
    short = dataclasses.replace(NOMINAL, simulation=dataclasses.replace(NOMINAL.simulation, duration=20.0))
    log = flown(short, LATE)
    by = round(0.4 * len(log.t))
    moved = dataclasses.replace(log, beta=np.roll(log.beta, by), beta_cmd=np.roll(log.beta_cmd, by))
    result = judged(moved, short, tuple(h for h in SOUGHT if h in FEW or h.where == place))
    assert not [name for name in names(result) if name.startswith(("actuator", "control"))], result["causes"]
    assert result["verdict"] in ("unexplained", "dominant")


# ---- long ones


@pytest.mark.campaign
@pytest.mark.parametrize("effects", [("control_effectiveness:scale=0.6", "moment_step:acceleration=0.01,time=18"),
                                     (LATE, "periodic_disturbance:amplitude=0.01,frequency=7")])
def test_the_same_flight_at_twice_the_rate_keeps_its_verdict(effects):
    """The noise is drawn anew; the first cause is known to the search, the second is not."""
    hypotheses = tuple(h for h in SOUGHT if h.cause != effects[1].partition(":")[0])
    slow, fast = (report(diagnose(flown(WINDY, *effects, seed=seed, period=period), WINDY, hypotheses=hypotheses))
                  for seed, period in ((1, 0.01), (2, 0.005)))
    assert slow["verdict"] == fast["verdict"] and names(slow) == names(fast)


@pytest.mark.campaign
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_weather_in_the_second_half_alone_is_consistent(seed):
    """The declared, and then there is none of it."""
    calm = dataclasses.replace(NOMINAL, simulation=dataclasses.replace(NOMINAL.simulation, duration=60.0))
    windy = dataclasses.replace(calm, wind=Wind(turbulence=0.005, initial=0.0))
    still, blown = flown(calm, seed=seed), flown(windy, seed=seed)
    air = fly_whole(windy, seed).wind
    half = np.where(blown.t < 30.0, 0.0, air[:len(blown.t)])
    flight = fly_whole(dataclasses.replace(calm, wind=Wind(profile=Forecast(blown.t, half))), seed)
    assert not np.array_equal(flight.theta, still.theta)
    result = report(diagnose(log_of(flight), windy))
    assert result["verdict"] == "consistent", result["doubts"]


# ---- what the wind's levels absorb of what is not modelled


@functools.cache
def explained_by(nominal):
    """The model that a diagnosis of a clean flight of this nominal ends with; shared, so nobody changes it."""
    return diagnose(flown(nominal), nominal, hypotheses=FEW).selection.model


def absorbed_by_a_fit(model, change):
    """The evidence [nats] that a cause with this change of the residual gains over a model without, whose levels are
    fitted: mean of both signs, in which what the noise has in common with it cancels."""
    record, base = model.fit.record, model.fit
    shift = np.einsum("kab,kb->ka", base.filter.low, change[:3 * record.rows].reshape(-1, 3))
    own = fit_levels(record, model.dynamics, base.innovations, base.filter, base.filter.levels)
    lost = []
    for sign in (1.0, -1.0):
        moved = fit_levels(record, model.dynamics, base.innovations + sign * shift, base.filter, own.levels)
        lost.append(likely(record, own) - likely(record, moved))
    return float(np.mean(lost))


def likely(record, filt):
    """Log-likelihood of levels, with what is declared of them."""
    return filt.log_likelihood - 0.5 * float(np.sum(np.log(filt.levels / declared(record))[5:]**2))


@pytest.mark.parametrize(("effect", "least", "most"), [
    ("lateral_drift:z_alpha=0.1,z_beta=0.0", 0.3, 0.6), ("control_loss:fraction=0.3,time=15", 0.6, 0.9),
    ("gyro_bias:rate=8e-5", 0.95, 1.01)])
def test_wind_takes_over_a_part_of_what_is_slow_and_nothing_of_a_sensor_s(effect, least, most):
    """An effect that nobody models raises the wind's levels: its gain is less than half its response's square."""
    model = explained_by(WINDY)
    problem = Problem(model.fit.record, model.fit.filter)
    project = Projector(problem, model.fit, causes=False)
    change = project.out(problem.residual(Point((from_text(effect),), model.fit.point.deviations)) - project.residual)
    absorbing, whole = Absorbing(model), 0.5 * square(change)
    gain = absorbing.gain(change)
    assert least * whole < gain < most * whole
    assert gain == pytest.approx(absorbed_by_a_fit(model, change), rel=0.15)
    times = absorbing.multiple(change, 20.0)
    assert absorbing.gain(times * change) == pytest.approx(20.0, rel=1e-3)
    assert Absorbing(explained_by(NOMINAL)).gain(change) == whole


def test_a_vehicle_less_stable_than_its_nominal_may_be_predicted_worse_than_by_it():
    """The commands over the horizon answer what pushed it in the horizon."""
    damping = tuple(each for each in SOUGHT if each.cause == "aero_damping")
    made = diagnose(flown(WINDY, "aero_damping:coefficient=-1.5", seed=2), WINDY, hypotheses=damping)
    before, after, _ = made.gain.squared["theta"]
    assert 2.0 > after / before > 1.2
    assert (made.verdict, [cause.cause for cause in made.causes]) == ("explained", ["aero_damping"])


@pytest.mark.parametrize("nominal", [WINDY, dataclasses.replace(WINDY, sensors=dataclasses.replace(
    WINDY.sensors, period=0.005))])
def test_a_change_weighs_twice_what_it_takes_from_the_likelihood_of_other_levels(nominal):
    """Nine sets, so that one stands in lanes of its own; rows that miss a channel among them."""
    log = flown(nominal)
    log = dataclasses.replace(log, theta_dot=np.where(np.arange(len(log.t)) % 7 == 3, math.nan, log.theta_dot))
    model = as_simulated(on_grid(log, nominal))
    fitted, record = model.fit, model.fit.record
    levels = fitted.filter.levels
    levels = levels * np.exp(0.3 * np.random.default_rng(2).standard_normal((9, len(levels))))
    refilter = Refilter(record, model.dynamics, fitted.innovations, fitted.filter)
    change = 1e-4 * np.random.default_rng(1).standard_normal((record.rows, 3)).cumsum(axis=0)
    change[~np.isfinite(fitted.innovations)] = math.nan
    still, moved = (Refilter(record, model.dynamics, base, fitted.filter).log_likelihoods(levels)
                    for base in (0.0 * change, change))
    assert Weighing(refilter, levels).energies(change) == pytest.approx(2.0 * (still - moved), rel=1e-9)


def test_the_wind_is_an_acceleration_in_units_of_the_nominal_s_a6():
    """Another a6 of the vehicle is not the better for making declared wind stronger or weaker."""
    own = np.array([2.0, 2.1, 2.2])
    world = np.array([[WIND, 1.0], [MOMENT, 1.0]])
    vehicle = SimpleNamespace(a6=10.0 * own, k1=np.zeros(3))
    assert push.py_func(vehicle, 1, world, np.array([0.1, 0.5]), own) == pytest.approx(0.22 + 0.5)
    r = on_grid(flown(NOMINAL), WINDY)
    doubled = Point((from_text("aero_instability:scale=2"),))
    wind = [each.name for each in r.world.sources].index(WALK) - len(r.world.sources)
    enters = [dynamics(r, point).f[:, 1, wind] for point in (Point(), doubled)]
    assert enters[1] == pytest.approx(enters[0], rel=1e-3)
