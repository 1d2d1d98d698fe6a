"""The diagnosis anew: what is hidden in a flight is named, what is not there is not, and the laws of its parts."""

import json

import numpy as np
import pytest
from hidden import draw_spec, fly

from launchid.diagnosis.adapter import read
from launchid.diagnosis.answer import lines, report
from launchid.diagnosis.believed import bending
from launchid.diagnosis.candidates import CANDIDATE_KINDS, lines_in
from launchid.diagnosis.model import Model
from launchid.diagnosis.scan import SQUARES_PROMISED, Scanner
from launchid.diagnosis.verdict import diagnose
from launchid.likelihood.command import nozzle_input, played
from launchid.likelihood.estimate import evaluate, fit_levels, gauss_newton, level_deviation
from launchid.log.log import flown_log, log_of_values
from sim.effects import CATALOGUE, from_text
from sim.flight import fly_whole
from sim.nominal import load_nominal

LONG = pytest.mark.campaign


def hidden(causes, seed, nominal="constant", factor=2.0, **given):
    """(log, truth) of a flight of the independent generator."""
    columns, label = fly(draw_spec(seed, causes, nominal, factor, **({"duration": 45.0, "rate": 100.0} | given)))
    return log_of_values("log.csv", columns), label


@pytest.fixture(scope="module")
def clean():
    """The model of a flight with nothing hidden."""
    log, _ = hidden(None, 71001, duration=30.0)
    return Model.of(read(log, load_nominal("constant")).track)


# ---- the answer with a known truth


@pytest.mark.parametrize(("cause", "most"), [("control_loss", 5.0), ("control_slope", 1e9)])
def test_a_sudden_loss_saves_at_its_time_alone_and_a_slope_is_no_loss(cause, most):
    log, label = hidden((cause,), 71043, reference="rough")
    m = Model.of(read(log, load_nominal("constant")).track)
    numbers = tuple(j for j, each in enumerate(m.table.numbers) if each.name != "k1_slope")
    loss = next(kind for kind in CANDIDATE_KINDS if kind.name == "control_loss")
    found = Scanner(m, gauss_newton(m, m.table.null, numbers)).best(loss)
    is_loss = found.saves > SQUARES_PROMISED and found.chance < most
    assert is_loss == (cause == "control_loss"), found
    if is_loss:
        assert found.values[0] == pytest.approx(label.causes[0]["parameters"]["time"], abs=0.1)


@pytest.mark.parametrize(("cause", "seed"), [pytest.param("control_loss", 91015, marks=LONG),
                                             pytest.param("control_slope", 71043, marks=LONG)])
def test_what_k1_does_in_time_has_one_name(cause, seed):
    log, _ = hidden((cause,), seed, reference="rough")
    found, = diagnose(log, load_nominal("constant")).named
    assert (found.cause, found.alike) == (cause, ())


def test_the_answer_is_the_contracts():
    log, label = hidden(("gyro_bias",), 71007, factor=4.0, duration=20.0)
    result = diagnose(log, load_nominal("constant"))
    answer = json.loads(json.dumps(report(result), allow_nan=False))
    assert {"verdict", "where", "causes", "noise", "limits", "gain", "either", "data", "remainder"} <= set(answer)
    cause = answer["causes"][0]
    assert cause["cause"] in CATALOGUE
    assert {"value", "std", "unit"} == set(rate := cause["parameters"]["rate"])
    assert abs(rate["value"] - label.causes[0]["parameters"]["rate"]) < 4.0 * rate["std"]
    assert cause["evidence"]["nats"] > 10.0
    assert 0.05 < cause["evidence"]["held_out"]
    assert answer["gain"]["held_out"] is True
    assert answer["gain"]["after"] <= answer["gain"]["before"]
    assert lines(result)[0].startswith("EXPLAINED (sensor): gyro_bias")


def test_an_attitude_bias_is_not_told_from_a_steady_wind():
    log, _ = hidden(("attitude_bias",), 71011, "vega_like", 4.0, rate=50.0)
    cause, = diagnose(log, load_nominal("vega_like")).named
    assert "attitude_bias" in {cause.cause, *cause.alike} and "steady_wind" in {cause.cause, *cause.alike}


@pytest.mark.parametrize("drop", [(), ("beta",)])
def test_an_input_of_another_time_is_another_controller_s(drop):
    """Nothing is said of the vehicle where the commands are not the law's, however the rows lie."""
    columns, _ = fly(draw_spec(71012, ("actuator_delay",), "constant", 2.0, duration=30.0, rate=100.0, drop=drop))
    turned = columns | {name: np.roll(columns[name], 1300) for name in ("beta", "beta_cmd") if name in columns}
    assert read(log_of_values("log.csv", turned), load_nominal("constant")).controller.is_foreign


def test_an_integral_is_another_law_where_the_log_misses_every_other_command():
    log, _ = hidden(("pilot_integral",), 71013, "vega_like", rate=50.0)
    assert read(log, load_nominal("vega_like")).controller.is_foreign


@pytest.mark.parametrize("term", ["theta^2", pytest.param("theta*theta_dot", marks=LONG)])
def test_a_term_of_the_second_order_is_not_called_another_curve(term):
    """Along one motion theta^2 is much like a6's own curve, theta^3."""
    nominal = load_nominal("constant")
    log = flown_log(fly_whole(nominal, 4, effects=[from_text(f"missing_term:term={term},coefficient=3")]))
    cause, = diagnose(log, nominal).named
    assert (cause.cause, cause.parameters["term"][0]) == ("missing_term", term)
    value, std = cause.parameters["coefficient"]
    assert abs(value - 3.0) < 4.0 * std


# ---- laws of the parts


def test_a_tone_that_climbs_is_found_among_noise(clean):
    """To the width of a line, 2 pi over the log, and to what turns the phase by as much at either end."""
    log = clean.log
    t = log.t[:-1] + 0.5 * log.dt - log.centre
    tone = 0.3 * np.sin(4.0 * t + 0.5 * 0.11 * t**2 + 1.0)
    e = np.where(log.channel == 1, tone[log.rows], 0.0) + np.random.default_rng(1).normal(size=len(log.rows))
    span = log.span
    frequency, climb = lines_in(clean, e, 1, climbs=True)[0]
    assert frequency == pytest.approx(4.0, abs=2.0 * np.pi / span)
    assert climb == pytest.approx(0.11, abs=8.0 * np.pi / span**2)


@pytest.mark.parametrize("frequency", [22.0, 40.0])
def test_a_mode_swings_as_the_continuous_one_at_its_frequency(clean, frequency):
    """A nozzle that swings with it for long: gain over twice the damping, a quarter of a turn later."""
    track, zeta = clean.log.track, 0.05
    step = track.period / track.sub
    time = step * np.arange(len(track.z) * track.sub)
    shift = bending(np.sin(frequency * time), frequency, zeta, track)[:, 0]
    steady = slice(len(shift) // 2, None)
    exact = -np.cos(frequency * time[::track.sub]) / (2.0 * zeta)
    assert np.std(shift[steady] - exact[steady]) < 0.03 * np.std(exact[steady])


def test_a_rate_limit_that_limits_nothing_gives_the_command_back(clean):
    log = clean.log
    u, out = log.base_input.ravel(), np.empty(log.base_input.size)
    nozzle_input(u, log.widths, log.servo_numbers(log.nominal_value), 0.0, 0.0, 1e6, out)
    assert out == pytest.approx(u, abs=1e-12)


def test_whitened_innovations_of_the_truth_are_white(clean):
    m = fit_levels(clean, clean.table.null, 4)
    e = evaluate(m, m.table.null).e
    assert abs(np.mean(e**2) - 1.0) < 0.05
    for channel in range(3):
        x = e[m.log.channel == channel]
        assert abs(np.corrcoef(x[1:], x[:-1])[0, 1]) < 0.08


def test_every_listed_cause_of_the_table_is_in_the_catalogue(clean):
    causes = {each.cause for each in (*clean.table.numbers, *CANDIDATE_KINDS)} - {""}
    assert causes <= set(CATALOGUE)


def test_a_noise_level_has_the_deviation_of_a_normal_sample(clean):
    """Of n rows the level is known to 1/sqrt(2 n) of itself, and less well by what the state takes of them."""
    m = fit_levels(clean, clean.table.null, 4)
    rows = np.count_nonzero(m.log.channel == 2)
    share = level_deviation(m, m.table.null, 2) / np.exp(m.levels[2])
    assert 1.0 < share * np.sqrt(2.0 * rows) < 1.6


def test_a_play_passes_on_the_mean_of_what_noise_makes_of_it():
    """Against 4000 noisy plays flown one by one; without noise it is the play itself."""
    rng, width, noise = np.random.default_rng(3), 8e-4, 7e-4
    u = 3e-3 * (np.sin(0.011 * np.arange(800)) + 0.5 * np.sin(0.029 * np.arange(800) + 1.0))
    sides, mean, plain, y = np.full(4000, u[0]), np.empty(800), np.empty(800), u[0]
    for i, x in enumerate(u):
        asked = x + noise * rng.normal(size=4000)
        sides = np.clip(sides, asked - width, asked + width)
        mean[i], y = sides.mean(), min(max(y, x - width), x + width)
        plain[i] = y
    out = np.empty(800)
    played(u, width, noise, out)
    assert np.std(out - mean) < 0.15 * np.std(mean - u) < 0.05 * np.std(plain - u)
    played(u, width, 0.0, out)
    assert np.array_equal(out, plain)


def test_a_gyro_that_is_whole_rows_late_is_put_back(clean):
    """The innovations of a column four rows late are those of the column itself, but for the rows that are lost."""
    columns, _ = fly(draw_spec(71001, None, "constant", 2.0, duration=30.0, rate=100.0))
    late = columns | {"theta_dot": np.append(np.full(4, columns["theta_dot"][0]), columns["theta_dot"][:-4])}
    m = Model.of(read(log_of_values("log.csv", late), load_nominal("constant")).track).retime(0.041)
    assert m.log.retimed == pytest.approx(0.04)
    p = m.table.null.copy()
    p[m.table.index("gyro_delay")] = m.log.retimed
    put_back, own = evaluate(m.with_levels(clean.levels), p).run, evaluate(clean, clean.table.null).run
    assert put_back.E[:-4] == pytest.approx(own.E[:-4], abs=1e-8)
    assert m.retime(0.043) is m
