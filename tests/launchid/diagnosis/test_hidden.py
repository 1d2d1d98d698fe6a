"""An effect is hidden in a log by a generator that knows nothing of the project; the diagnosis must find it.

What is hidden, where and how strongly is drawn by hypothesis (derandomised in CI) or from seeds; the label is looked at
after the verdict.  Flights with a label of their own stand in the labelled set (`test_diagnosis_set.py`); the benchmark
`benchmarks/diagnosis.py` counts rates.
"""

import dataclasses

import numpy as np
import pytest
from hidden import LISTED, OTHER, PLAIN, UNLISTED, draw_spec, fly, write_csv
from hidden.spec import Hidden
from hidden.vehicles import vehicle
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from test_diagnosis import equivalents

from launchid.diagnosis.causes import SOUGHT
from launchid.diagnosis.controller.command import record
from launchid.diagnosis.controller.issued import with_commands
from launchid.diagnosis.judge.closed_loop import closed_loop_errors
from launchid.diagnosis.model.follower import NominalFollower
from launchid.diagnosis.model.point import innovations
from launchid.diagnosis.report.answer import report
from launchid.diagnosis.search.profile import as_simulated
from launchid.diagnosis.verdict import diagnose
from launchid.log.detect import check
from launchid.log.log import read_log
from sim.effects import CATALOGUE, effect
from sim.nominal import load_nominal

SECONDS = 45.0       # of the flights of the default run; what begins somewhere in a flight gets a whole one
BRIEF = {"gyro_bias", "gyro_scale", "actuator_bias"}  # which half a minute shows as well
BEGINNING = ("control_loss", "moment_step", "gust")
VISIBLE = 2.0        # times a clearly visible size (`size_at`)
ALIKE = 0.999        # |cosine| of exact equivalents
FEW = ("control_loss", "aero_damping", "slosh", "bending", "gust", "actuator_delay", "actuator_backlash", "gyro_scale",
       "attitude_delay", "nozzle_sensor_bias")


def chosen(among):
    """The hypotheses of these causes; of all where among is None."""
    return None if among is None else tuple(h for h in SOUGHT if h.cause in among)


def diagnosed(folder, spec, drop_hypothesis=None, order=None, among=None):
    """(JSON, label, Diagnosis) of a hidden flight, through the contract's CSV; among: the causes that are sought."""
    columns, label = fly(spec)
    path = folder / f"log{len(list(folder.iterdir()))}.csv"
    write_csv(path, columns, order)
    known = chosen(among)
    if drop_hypothesis is not None:
        known = tuple(h for h in SOUGHT if h.cause != drop_hypothesis)
    made = diagnose(read_log(path, ("t", "theta")), load_nominal(spec.nominal), hypotheses=known)
    return report(made), label, made


def seconds(cause):
    return None if cause in BEGINNING else SECONDS


def briefly(cause):
    return 30.0 if cause in BRIEF else seconds(cause)


def answers(result):
    """Each reported cause with what it cannot be told from."""
    return [{cause["cause"], *cause["indistinguishable_from"]} for cause in result["causes"]]


def truth(label):
    return [cause["cause"] for cause in label.causes]


def found(result, label):
    """Every hidden cause is in an answer, and every answer holds one (two bending modes may be named twice)."""
    sets, causes = answers(result), set(truth(label))
    return all(any(name in one for one in sets) for name in causes) and all(one & causes for one in sets)


@settings(max_examples=1, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(cause=st.sampled_from(FEW), seed=st.integers(0, 2**20), variant=st.sampled_from([PLAIN, OTHER]),
       rate=st.sampled_from([50.0, 100.0]))
def test_what_is_hidden_is_found(tmp_path, cause, seed, variant, rate):
    spec = draw_spec(seed, cause=cause, factor=VISIBLE, variant=variant, rate=rate, duration=seconds(cause))
    result, label, _ = diagnosed(tmp_path, spec)
    assert found(result, label), (spec, result["verdict"], answers(result), result["doubts"], result["nearest"])


def an_integral_part(seed):
    return draw_spec(seed, cause="pilot_integral", nominal="vega_like", factor=2.0, rate=50.0)


def test_an_integral_part_in_every_other_command_is_no_other_gain(tmp_path):
    """No filter is named either: gains that leave three times the noise explain nothing."""
    columns, _ = fly(an_integral_part(11))
    write_csv(tmp_path / "log.csv", columns)
    log, nominal = read_log(tmp_path / "log.csv", ("t", "theta")), load_nominal("vega_like")
    _, controller = with_commands(record(log, nominal, check(log, nominal)), NominalFollower())
    assert controller.is_foreign and not controller.is_named


@pytest.mark.parametrize("seed", [31, 32])
def test_a_bent_attitude_in_every_other_command_is_no_other_gain(tmp_path, seed):
    """The nozzle does not confirm the gains that the errors between the rows, predicted by that sensor, ask for."""
    columns, _ = fly(draw_spec(seed, cause="attitude_curve", factor=VISIBLE, variant=PLAIN, rate=50.0))
    write_csv(tmp_path / "log.csv", columns)
    log, nominal = read_log(tmp_path / "log.csv", ("t", "theta")), load_nominal("constant")
    _, controller = with_commands(record(log, nominal, check(log, nominal)), NominalFollower())
    assert not controller.is_named


@pytest.mark.campaign
@pytest.mark.parametrize("seed", [11, 12, 13])
def test_an_integral_part_in_every_other_command_is_not_named(tmp_path, seed):
    """The nozzle's motion between them is not its own fault either."""
    result, label, _ = diagnosed(tmp_path, an_integral_part(seed))
    assert (result["verdict"], result["where"], result["causes"]) == ("unexplained", "controller", []), label


# ---- metamorphic


def mirrored(columns):
    return {name: value if name == "t" else -value for name, value in columns.items()}


@pytest.mark.parametrize("cause", ["gyro_bias", *(pytest.param(name, marks=pytest.mark.campaign)
                                                  for name in ("slosh", "gust", "actuator_gain"))])
def test_mirrored_reordered_thinned_and_doubled_logs_get_the_same_name(tmp_path, cause):
    spec = draw_spec(5, cause=cause, factor=VISIBLE, variant=PLAIN, rate=100.0, duration=briefly(cause))
    columns, label = fly(spec)
    nominal = load_nominal("constant")
    thinned = {name: value[::2] for name, value in columns.items()}
    double, _ = fly(draw_spec(5, cause=cause, factor=2.0 * VISIBLE, variant=PLAIN, rate=100.0,
                            duration=briefly(cause)))
    plain, reordered = tmp_path / "plain.csv", tmp_path / "reordered.csv"
    write_csv(plain, columns, None)
    write_csv(reordered, columns, sorted(columns, reverse=True))
    read = [read_log(path) for path in (plain, reordered)]
    assert set(read[0].columns) == set(read[1].columns)
    for name in read[0].columns:  # the diagnosis sees no more of a log than this
        assert np.array_equal(getattr(read[0], name), getattr(read[1], name))
    for k, log in enumerate((mirrored(columns), thinned, double)):
        path = tmp_path / f"{k}.csv"
        write_csv(path, log, None)
        result = report(diagnose(read_log(path), nominal))
        assert found(result, label), (k, result["verdict"], answers(result), result["doubts"])


@pytest.mark.parametrize("cause", ["actuator_bias", pytest.param("actuator_gain", marks=pytest.mark.campaign),
                                   pytest.param("thrust_misalignment", marks=pytest.mark.campaign)])
def test_without_the_nozzle_column_the_set_holds_the_truth(tmp_path, cause):
    factor = 40.0 if cause.startswith("actuator") else VISIBLE   # the nozzle sensor was what showed them
    spec = draw_spec(6, cause=cause, factor=factor, variant=PLAIN, rate=100.0, drop=("beta",), duration=briefly(cause))
    result, label, _ = diagnosed(tmp_path, spec)
    assert found(result, label), (result["verdict"], answers(result), result["doubts"])
    assert len(answers(result)[0]) > 1


# ---- one hypothesis less


@pytest.mark.parametrize("cause", [name if name == "gyro_scale" else
                                   pytest.param(name, marks=pytest.mark.campaign)
                                   for name in LISTED if name != "controller_mismatch"])
def test_without_its_hypothesis_an_effect_gets_no_other_name(tmp_path, cause):
    spec = draw_spec(9, cause=cause, factor=VISIBLE, variant=PLAIN, rate=100.0, duration=briefly(cause))
    result, label, made = diagnosed(tmp_path, spec, drop_hypothesis=cause)
    alike = equivalents(made.isolability, cause, ALIKE)
    print(cause, "exact equivalents in this log:", ", ".join(" with ".join(each) for each in alike) or "none")
    named = {one["cause"] for one in result["causes"]}
    assert not named or any(named == set(each) for each in alike), (label, answers(result), result["doubts"])


def test_a_first_order_lag_of_the_servo_is_a_delay_and_no_slower_servo(tmp_path):
    """The set that answers `actuator_bandwidth` in its other form is right: responses of the innovations, the same
    noise in all."""
    craft, slower = vehicle("constant"), -4.0
    lag = 2.0 * craft.servo_damping / craft.servo_frequency * (1.0 / (1.0 + slower / 100.0) - 1.0)
    hidden = [(), (Hidden("lazy_servo", (("percent", slower),), OTHER),),
              (Hidden("late_servo", (("ms", 1e3 * lag),)),), (Hidden("lazy_servo", (("percent", slower),)),)]
    clean, white = None, []
    for k, effects in enumerate(hidden):
        write_csv(tmp_path / f"{k}.csv", fly(dataclasses.replace(draw_spec(5, rate=100.0, duration=SECONDS),
                                                                 effects=effects))[0])
        log, nominal = read_log(tmp_path / f"{k}.csv"), load_nominal("constant")
        of = record(log, nominal, check(log, nominal))
        clean = clean or as_simulated(of)
        white.append(clean.fit.filter.whiten(innovations(of, clean.fit.filter, clean.fit.point)[0]).ravel())
    lagged, late, lazy = ((each - white[0]) / np.linalg.norm(each - white[0]) for each in white[1:])
    assert lagged @ late > 0.995 and abs(lagged @ lazy) < 0.6


# ---- the gain


@pytest.mark.parametrize("among", [
    pytest.param(("control_loss", "control_effectiveness", "aero_damping", "gyro_bias", "actuator_delay"), id="few"),
    pytest.param(None, id="all", marks=pytest.mark.campaign)])
def test_the_extension_beats_the_nominal_on_a_fresh_flight_and_another_label_does_not(tmp_path, among):
    spec = draw_spec(31, cause="control_loss", factor=4.0, variant=PLAIN, rate=100.0)
    result, label, made = diagnosed(tmp_path, spec, among=among)
    assert found(result, label)
    columns, _ = fly(dataclasses.replace(spec, seed=32))
    write_csv(tmp_path / "fresh.csv", columns)
    fresh = report(diagnose(read_log(tmp_path / "fresh.csv"), made.extension, hypotheses=chosen(among)))
    assert fresh["verdict"] == "consistent", fresh["doubts"]
    before, after = closed_loop_errors(made.record, made.extension.effects)
    assert after < 0.7 * before
    _, shuffled = closed_loop_errors(made.record, (effect("aero_damping", coefficient=0.3),))
    assert shuffled > before


def test_the_generator_and_the_catalogue_list_the_same_causes():
    assert set(LISTED) | {"missing_term"} == set(CATALOGUE)
    assert not set(UNLISTED) & set(CATALOGUE)
    assert len(UNLISTED) >= 6
