"""The data check in front of identify, uncertainty and fit-lft: units, signs and stamps, one line, --strict."""

import dataclasses
import math
import warnings
from pathlib import Path

import numpy as np
import pytest
from shortened import short

import launchid
from launchid.log.check import COLUMN_FAULTS, checked, faults
from launchid.log.log import Log, flown_log, log_of, write_columns
from sim.effects import from_text
from sim.errors import InputError
from sim.flight import fly_whole
from sim.nominal import BUILT_IN, Nominal, load_nominal, write_nominal
from sim.sections import Offsets, Profile, Wind

DURATION = 30.0  # s: with the first manoeuvres of every built-in nominal
DEGREES = math.degrees
COLUMNS = {"all": ("t", "theta", "theta_dot", "beta", "beta_cmd", "theta_ref"),
           "without command": ("t", "theta", "theta_dot", "beta"), "required": ("t", "theta", "beta")}
ANGLES = ("theta", "theta_dot", "beta", "beta_cmd", "theta_ref")
FAULTS = {
    "theta in degrees": ({"theta": DEGREES(1.0)}, {"unit"}), "beta in degrees": ({"beta": DEGREES(1.0)}, {"unit"}),
    "beta and command in degrees": ({"beta": DEGREES(1.0), "beta_cmd": DEGREES(1.0)}, {"unit"}),
    "everything in degrees": (dict.fromkeys(ANGLES, DEGREES(1.0)), {"unit"}),
    "beta reversed": ({"beta": -1.0}, {"sign"}), "theta reversed": ({"theta": -1.0}, {"sign"}),
    "beta and command reversed": ({"beta": -1.0, "beta_cmd": -1.0}, {"sign"}),
    "theta and rate reversed": ({"theta": -1.0, "theta_dot": -1.0, "theta_ref": -1.0}, {"sign"})}


def flown(nominal: Nominal, seed: int, columns: str = "all", factors: dict[str, float] | None = None) -> Log:
    log = flown_log(fly_whole(nominal, seed))
    return log_of({name: x * (factors or {}).get(name, 1.0) for name, x in log.measured().items()
                   if name in COLUMNS[columns]})


def kinds(log: Log, nominal: Nominal | None) -> set[str]:
    return {fault.kind for fault in faults(log, nominal)}


@pytest.fixture(scope="module")
def nominals() -> dict[str, Nominal]:
    return {name: short(DURATION, name) for name in BUILT_IN}


@pytest.mark.parametrize("name", BUILT_IN)
def test_units_and_signs_are_seen_whatever_columns_there_are(nominals, name):
    whole = flown(nominals[name], 1).measured()
    for fault, (factors, expected) in FAULTS.items():
        for columns, names in COLUMNS.items():
            log = log_of({column: whole[column] * factors.get(column, 1.0) for column in names})
            assert kinds(log, nominals[name]) == expected, (fault, columns)


HARMLESS = ("", "steady_wind:angle=0.03", "gust:angle=0.05,time=10,duration=6", "attitude_bias:angle=0.005",
            "thrust_misalignment:angle=0.004", "control_loss:fraction=0.5,time=12", "control_effectiveness:scale=0.6",
            "aero_instability:scale=1.5", "actuator_delay:delay=0.03", "bending:gain=0.1,frequency=15",
            "periodic_disturbance:amplitude=0.01,frequency=5", "slosh:coupling=0.05,frequency=3.5")


@pytest.mark.parametrize("effect", HARMLESS)
@pytest.mark.parametrize("name", BUILT_IN)
def test_no_effect_of_the_vehicle_or_the_air_is_a_unit_or_a_sign(nominals, name, effect):
    whole = flown_log(fly_whole(nominals[name], 2, effects=[from_text(effect)] if effect else [])).measured()
    for columns in COLUMNS.values():
        log = log_of({column: whole[column] for column in columns})
        assert not kinds(log, nominals[name]) & set(COLUMN_FAULTS)
        assert not kinds(log, None) & set(COLUMN_FAULTS)


@pytest.mark.parametrize("name", BUILT_IN)
def test_wind_and_offsets_are_no_unit_and_no_sign(nominals, name):
    windy = dataclasses.replace(nominals[name], wind=Wind(walk=0.02, turbulence=0.03),
                                offsets=Offsets(thrust_misalignment=0.004, attitude_bias=0.005, gyro_bias=0.002))
    for columns in COLUMNS:
        assert not kinds(flown(windy, 0, columns), nominals[name])


# ---- the commands


@pytest.fixture
def written(tmp_path: Path, nominals) -> Path:
    """A clean log and one of each sort of fault, and the nominal."""
    write_nominal(nominals["constant"], tmp_path / "n.toml")
    for name, factors in (("clean", {}), ("turned", {"beta": -1.0, "beta_cmd": -1.0}), ("late", {"t": 1000.0})):
        write_columns(tmp_path / f"{name}.csv", flown(nominals["constant"], 1, "all", factors).measured())
    columns = flown(nominals["constant"], 1).measured()
    write_columns(tmp_path / "twice.csv", {name: np.insert(x, 500, x[499]) for name, x in columns.items()})
    return tmp_path


COMMANDS = {"identify": ["identify", "LOG", "--nominal", "N", "--window", "5"],
            "uncertainty": ["uncertainty", "LOG", "N", "--window", "5"]}


@pytest.mark.parametrize("command", COMMANDS)
def test_one_line_of_warning_and_exit_3_with_strict(launchid, written, command):
    def words(log: str, *more: str) -> list[str]:
        places = {"LOG": str(written / f"{log}.csv"), "N": str(written / "n.toml")}
        return [places.get(word, word) for word in COMMANDS[command]] + list(more)

    status, _, err = launchid(*words("clean", "--strict"))
    assert (status, err) == (0, "")
    for log, mention in (("turned", "opposite sign"), ("twice", "repeated stamps")):
        status, out, err = launchid(*words(log))
        assert status == 0 and out != "" and len(err.splitlines()) == 1
        assert "data check" in err and mention in err and f"{log}.csv" in err
        status, out, err = launchid(*words(log, "--strict"))
        assert (status, out) == (3, "") and len(err.splitlines()) == 1 and mention in err
    status, out, err = launchid(*words("late"))
    assert (status, out) == (3, "") and len(err.splitlines()) == 1 and "column t" in err and "milliseconds" in err


def test_rows_that_are_said_to_be_left_out_are(nominals):
    log = flown(nominals["constant"], 1)
    log.theta_dot[1000:1200] = 0.0
    with pytest.warns(launchid.DataWarning, match="exactly zero for 200 rows.*left out"):
        made = launchid.identify(log, nominals["constant"], window=5)
    assert np.isnan(made.log.theta_dot[1000:1200]).all() and np.isfinite(made.log.theta_dot[999])


def test_diagnose_is_strict_too(launchid, written):
    status, out, err = launchid("diagnose", written / "turned.csv", written / "n.toml", "--strict")
    assert (status, out) == (3, "") and "opposite sign" in err


def test_fit_lft_refuses_a_foreign_column_and_fits_what_lost_a_stamp(launchid, written):
    words = ["fit-lft", "LOG", written / "n.toml", "--out", written / "new.toml"]
    for log, status in (("turned", 3), ("late", 3), ("twice", 0)):
        (written / "new.toml").unlink(missing_ok=True)
        found, _, err = launchid(*[written / f"{log}.csv" if word == "LOG" else word for word in words])
        assert found == status and len(err.splitlines()) == 1
        assert (written / "new.toml").exists() == (status == 0)
    assert launchid("fit-lft", written / "twice.csv", written / "n.toml", "--out", written / "x.toml",
               "--strict")[0] == 3


def test_from_python_it_is_a_warning_or_an_error(nominals):
    log = flown(nominals["constant"], 1, "all", {"beta": -1.0, "beta_cmd": -1.0})
    with pytest.warns(launchid.DataWarning, match="opposite sign") as caught:
        launchid.identify(log, nominals["constant"], window=5)
    assert [Path(each.filename).name for each in caught] == [Path(__file__).name]
    with pytest.raises(InputError, match="opposite sign"):
        launchid.identify(log, nominals["constant"], window=5, strict=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        launchid.identify(flown(nominals["constant"], 1), nominals["constant"], window=5)


def test_a_log_of_two_rows_or_of_nothing_known_is_judged(nominals):
    nothing = np.full(200, math.nan)
    for t in (np.array([0.0, 0.01]), np.arange(200) * 0.01):
        still = {"t": t, "theta": np.zeros(len(t)), "beta": np.zeros(len(t)), "theta_dot": nothing[:len(t)]}
        assert not kinds(log_of(still), nominals["constant"]) & set(COLUMN_FAULTS)


# ---- a profile that is shorter than the flight


def test_a_profile_that_ends_before_the_flight_is_one_line(launchid, tmp_path, nominals):
    nominal = nominals["constant"]
    ends = dataclasses.replace(nominal, vehicle=Profile(np.array([0.0, 20.0]), np.array([2.0, 2.0]),
                                                        np.array([-7.0, -7.0])))
    write_nominal(ends, tmp_path / "n.toml")
    status, _, err = launchid("simulate", tmp_path / "n.toml", "--out", tmp_path / "log.csv")
    assert status == 0 and len(err.splitlines()) == 2 and "profile ends at 20 s, the flight at 30 s" in err
    status, _, err = launchid("identify", tmp_path / "log.csv", "--nominal", tmp_path / "n.toml", "--window", "5")
    assert status == 0 and len(err.splitlines()) == 1 and "profile ends at 20 s" in err
    write_nominal(nominal, tmp_path / "whole.toml")
    _, _, err = launchid("simulate", tmp_path / "whole.toml", "--out", tmp_path / "log.csv")
    assert len(err.splitlines()) == 1


@pytest.mark.parametrize("name", BUILT_IN)
def test_built_in_profiles_cover_their_flights(name):
    nominal = load_nominal(name)
    assert nominal.simulation is not None
    assert len(nominal.vehicle.t) == 1 or nominal.vehicle.t[-1] >= nominal.simulation.duration


SCALED = [("constant", "gyro_scale:scale=1.05", 1.05), *((name, "gyro_scale:scale=0.9", 0.9) for name in BUILT_IN)]
UNSCALED = [("vega_like", effect, None) for effect in (
    "", "gyro_delay:delay=0.02", "gyro_bias:rate=0.002", "attitude_delay:delay=0.03")]


@pytest.mark.parametrize(("name", "effect", "scale"), [*SCALED, *UNSCALED])
def test_a_gyro_whose_scale_is_not_the_attitude_s_is_told_and_corrected(name, effect, scale):
    log = flown_log(fly_whole(short(DURATION, name), 3, effects=[from_text(effect)] if effect else []))
    said = [fault.message for fault in checked(log).sensed.faults if fault.kind == "scale"]
    assert len(said) == (scale is not None) and not faults(log, None)
    if scale is not None:
        assert float(said[0].partition("theta_dot is ")[2].partition(" ")[0]) == pytest.approx(scale, abs=0.006)
    if scale == 1.05:
        with pytest.warns(launchid.DataWarning, match="times the slope of theta"):
            windows = [w for w in launchid.identify(log, window=10.0).report["windows"] if w["valid"]]
        assert windows and all(abs(w["k1"] + 7.0) < 4.0 * w["k1_std"] for w in windows)
        with pytest.raises(InputError, match="times the slope of theta"):
            checked(log, strict=True)
