"""One checked log for every command: what stands at fault in it is not measured, its stamps lie on their grid.

Flights of `public_flights`, a6 = 2 and k1 = -6, spoilt as loggers spoil them.
"""

import ast
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import public_flights as flights
import pytest

import launchid
from launchid.commands.identify import Identification, identify
from launchid.diagnosis.adapter import read
from launchid.log.check import CheckedLog, checked
from launchid.log.live import LiveCheck, part, rows_of
from launchid.log.log import Log, flown_columns, flown_log, log_of
from launchid.watch.follower import Follower
from sim.errors import InputError
from sim.flight import fly_whole
from sim.nominal import Nominal, load_nominal

Columns = dict[str, np.ndarray]
MOST = 4.0     # standard deviations
ROOT = Path(launchid.__file__).parent


@pytest.fixture(scope="module")
def plain() -> Columns:
    columns = flights.fly(20.0)
    return {name: columns[name] for name in ("t", "theta", "theta_dot", "beta")}


def off(made: Identification) -> float:
    """Standard deviations by which the worst number of an OK window is off."""
    return max((abs(w[name] - true) / w[f"{name}_std"] for w in made.report["windows"] if w["valid"]
                for name, true in (("a6", 2.0), ("k1", -6.0))), default=0.0)


def is_ok(made: Identification) -> bool:
    return {w["status"] for w in made.report["windows"]} == {"OK"}


# ---- stamps


@pytest.mark.parametrize(("tick", "period", "start"), [
    (0.008, 0.01, 0.0), (0.01, 0.012, 0.0), (1.0 / 128.0, 0.01, 1e5), (0.001, 1.0 / 300.0, 5.0), (0.1, 0.01, 0.0)])
def test_stamps_within_their_resolution_of_a_grid_are_of_it(plain, tick, period, start):
    t = start + period * np.arange(len(plain["t"]))
    seen = checked(log_of(plain | {"t": np.round(tick * np.floor(t / tick + 1e-9), 6),
                                   "theta_dot": plain["theta_dot"] * 0.01 / period}))
    assert np.allclose(np.diff(seen.log.t), period, rtol=1e-4) and seen.faults == ()
    said = float(seen.notes[0].partition("rows are ")[2].split()[0])
    assert "stamps are rounded" in seen.notes[0] and said == pytest.approx(period, rel=1e-4)


def test_rows_that_are_lost_too_keep_their_gap(plain):
    rows = np.delete(np.arange(len(plain["t"])), np.r_[500:530, 900])
    t = 0.008 * np.floor(plain["t"] / 0.008 + 1e-9)
    seen = checked(log_of({name: (t if name == "t" else x)[rows] for name, x in plain.items()}))
    assert np.allclose(seen.log.t - seen.log.t[0], plain["t"][rows], atol=0.004)
    fault, = seen.faults
    assert "about 31 rows missing in 2 gaps" in fault.message


@pytest.mark.parametrize("t", [
    pytest.param(lambda t, rng: t + 0.002 * rng.uniform(-1.0, 1.0, len(t)), id="jitter"),
    pytest.param(lambda t, rng: np.round(t + 0.003 * rng.normal(size=len(t)), 3), id="jitter with digits"),
    pytest.param(lambda t, rng: np.sort(np.append(t[:-1], t[500])), id="a row written twice"),
    pytest.param(lambda t, rng: t, id="even")])
def test_stamps_that_are_of_no_grid_stay(plain, t):
    stamps = t(plain["t"], np.random.default_rng(1))
    assert np.array_equal(checked(log_of(plain | {"t": stamps})).log.t, stamps)


def test_numbers_of_rounded_stamps_are_those_of_even_ones(plain):
    made = identify(log_of(plain | {"t": 0.008 * np.floor(plain["t"] / 0.008 + 1e-9)}), window="all")
    assert is_ok(made) and off(made) < 3.0 and "lost" not in made.summary()


@pytest.mark.parametrize(("unit", "factor"), [("minutes", 60.0), ("hours", 3600.0)])
def test_t_in_a_long_unit_is_refused_with_that_unit(plain, unit, factor):
    with pytest.raises(InputError, match=f"looks like {unit}.*multiply it by {factor:g}"):
        checked(log_of(plain | {"t": plain["t"] / factor}))


def test_an_attitude_in_counts_is_no_clock_in_hours(plain):
    counts = plain | {"theta": 5700.0 * plain["theta"]}
    assert "times the slope of theta" in " ".join(checked(log_of(counts)).warnings)


def test_t_in_days_is_no_time_of_rows(plain):
    with pytest.raises(InputError, match="median step"):
        checked(log_of(plain | {"t": plain["t"] / 86400.0}))


# ---- rows that were not measured


def zeros(columns: Columns, share: float) -> Columns:
    rows = np.random.default_rng(3).random(len(columns["t"])) < share
    return {name: np.where(rows, 0.0, x) if name != "t" else x for name, x in columns.items()}


def clipped(columns: Columns) -> Columns:
    top = 0.47 * np.max(columns["theta_dot"])
    return columns | {"theta_dot": np.minimum(columns["theta_dot"], top)}


def overflowing(columns: Columns) -> Columns:
    end = 0.6 * np.max(np.abs(columns["theta_dot"]))
    return columns | {"theta_dot": (columns["theta_dot"] + end) % (2.0 * end) - end}


def spiked(columns: Columns) -> Columns:
    theta = columns["theta"].copy()
    theta[7::50] += 0.3
    return columns | {"theta": theta}


@pytest.mark.parametrize(("spoil", "channel", "least"), [
    (lambda c: zeros(c, 0.01), "beta", 5), (lambda c: zeros(c, 0.03), "theta", 30), (clipped, "theta_dot", 100),
    (overflowing, "theta_dot", 50), (spiked, "theta", 30)],
    ids=["zeros", "more zeros", "one stop", "overflow", "spikes"])
def test_rows_at_fault_are_not_measured_and_the_numbers_hold(plain, spoil, channel, least):
    spoilt = log_of(spoil(plain))
    seen = checked(spoilt)
    gone = np.isfinite(getattr(spoilt, channel)) & ~np.isfinite(getattr(seen.log, channel))
    assert gone.sum() >= least and len(seen.faults) > 0
    same = ~gone & np.isclose(getattr(spoilt, channel), plain[channel])
    assert np.array_equal(getattr(seen.log, channel)[same], getattr(spoilt, channel)[same])
    made = identify(spoilt, window="all")
    assert off(made) < MOST and {w["status"] for w in made.report["windows"]} <= {"OK", "UNCHECKED"}
    with pytest.raises(InputError, match="data check"):
        identify(spoilt, strict=True)


def test_what_is_masked_is_not_measured(plain):
    hidden = np.arange(len(plain["t"])) % 50 == 0
    beta = np.ma.masked_where(hidden, np.where(hidden, 9.0, plain["beta"]))
    made = identify(log_of(plain | {"beta": beta}), window="all")
    assert made.report["samples"]["rejected"] == {"NONFINITE": 40}
    assert is_ok(made) and off(made) < 3.0


def test_single_missing_cells_are_no_gaps(plain):
    rng = np.random.default_rng(2)
    holed = plain | {name: np.where(rng.random(2000) < 0.15, math.nan, plain[name]) for name in ("theta", "beta")}
    made, whole = (identify(log_of(columns), window="all").report["windows"][0] for columns in (holed, plain))
    assert made["status"] == "OK" and made["a6_std"] < 2.5 * whole["a6_std"]
    assert abs(made["a6"] - 2.0) < MOST * made["a6_std"] and abs(made["k1"] + 6.0) < MOST * made["k1_std"]


def test_a_start_beyond_half_a_turn_has_its_whole_turns_taken_out(plain):
    seen = checked(log_of(plain | {"theta": plain["theta"] + 2.0 * math.pi - 0.02}))
    assert seen.log.theta == pytest.approx(plain["theta"] - 0.02) and "whole turn" in seen.notes[0]
    over = checked(log_of(plain | {"theta": (plain["theta"] + 2.0 * math.pi) % (2.0 * math.pi)}))
    assert np.ptp(over.log.theta) == pytest.approx(np.ptp(plain["theta"])) and "put back" in over.notes[0]


# ---- columns of another quantity


@pytest.mark.parametrize(("factor", "words"), [
    (180.0 / math.pi, "alpha looks like degrees"), (-1.0, "alpha has the opposite sign")])
def test_an_alpha_of_another_unit_or_sign_is_told_and_refused(factor, words):
    flight = flights.fly(20.0, drift=0.4)
    gamma = flight.pop("gamma")
    made = identify(log_of(flight | {"alpha": factor * (flight["theta"] - gamma)}), window="all")
    assert not any(w["valid"] for w in made.report["windows"])
    assert words in made.report["next"] and words in made.warnings[0]


def test_a_gamma_of_another_unit_is_refused_for_that():
    flight = flights.fly(20.0, drift=0.4)
    made = identify(log_of(flight | {"gamma": np.degrees(flight["gamma"])}), window="all")
    assert not any(w["valid"] for w in made.report["windows"]) and "gamma does not act" in made.report["next"]


def imported(path: Path) -> dict[str, set[str]]:
    """The names that a module imports from each other one, by the last two parts of its name."""
    found: dict[str, set[str]] = {}
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            found.setdefault(".".join((node.module or "").split(".")[-2:]), set()).update(x.name for x in node.names)
    return found


def test_every_command_takes_the_checked_log():
    """What reads the rows of a log, beside the rooms that make one, gets them from the check; nothing else seeks
    faults."""
    detectors = {f"log.{name}" for name in ("detect", "channels", "stops", "stamps", "relations", "slope", "turns")}
    for path in sorted(ROOT.rglob("*.py")):
        if path.relative_to(ROOT).parts[0] not in ("log", "convert"):
            names = set().union(*(of for module, of in imported(path).items() if module in detectors))
            assert names <= {"ONE_MOTION", "usable_rows", "DataCheck", "SENSOR_COLUMNS"}, path
    doors = {"diagnose": "diagnosis/adapter.py", "nominal": "first_nominal/answer.py", "watch": "watch/follower.py",
             "show": "report/log_figures.py", "identify": "identification/log.py", "margins": "identification/log.py"}
    makers = {"convert", "simulate"}   # of logs
    for path in sorted((ROOT / "commands").glob("*.py")):
        read = set().union(*imported(path).values()) & {"read_log", "read_noting", "read_each", "open_source"}
        if read and path.stem not in makers:
            names = imported(ROOT / doors.get(path.stem, f"commands/{path.name}"))
            assert (names.get("log.check", set()) & {"checked", "examined"}) or "checked_flight" in names.get(
                "log.phases", set()) or "LiveCheck" in names.get("log.live", set()), path
    assert isinstance(checked(log_of(flights.fly(2.0))), CheckedLog)


@pytest.fixture(scope="module")
def spoilt_and_emptied() -> tuple[Nominal, Log, Log]:
    """A nominal, and its flight with spikes, zeros for missing and a gyro that freezes; the same without these cells
    (the first of equal values was measured)."""
    nominal = load_nominal("constant")
    columns = flown_columns(fly_whole(nominal, 5))
    spoilt, emptied = ({name: x[:1500].copy() for name, x in columns.items()} for _ in range(2))
    for row in (200, 450, 700):
        spoilt["theta_dot"][row], emptied["theta_dot"][row] = 0.6, math.nan
    for name in ("theta", "theta_dot", "beta"):
        spoilt[name][900:904], emptied[name][900:904] = 0.0, math.nan
    spoilt["theta_dot"][1100:1140], emptied["theta_dot"][1101:1140] = spoilt["theta_dot"][1100], math.nan
    return nominal, log_of(spoilt), log_of(emptied)


def test_a_diagnosis_reads_no_row_at_fault(spoilt_and_emptied):
    nominal, spoilt, emptied = spoilt_and_emptied
    one, other = (read(log, nominal).track for log in (spoilt, emptied))
    assert np.array_equal(one.z, other.z, equal_nan=True) and np.array_equal(one.commands, other.commands)
    assert np.count_nonzero(np.isnan(one.z[:, 1])) == 3 + 4 + 39


def test_what_is_watched_has_no_row_at_fault(spoilt_and_emptied):
    """While rows come, in pieces of any length."""
    nominal, spoilt, emptied = spoilt_and_emptied
    reports = []
    for log, piece in ((spoilt, 1500), (spoilt, 7), (emptied, 7)):
        follower = Follower("log", nominal, window=5.0, period=0.01)
        for begin in range(0, 1500, piece):
            follower.take(part(log, begin, min(begin + piece, 1500)))
        follower.end()
        reports.append(follower.report())
    assert reports[0] == reports[1] == reports[2] and all(w["valid"] for w in reports[0]["windows"])


@pytest.mark.parametrize("quantum", [0.0, 2e-3])
def test_a_sound_flight_passes_the_live_check_as_it_is(quantum):
    log = part(flown_log(fly_whole(load_nominal("constant"), 0)), 1500, 4000)
    if quantum:
        log = replace(log, **{name: quantum * np.round(getattr(log, name) / quantum)
                              for name in ("theta", "theta_dot", "beta")})
    live = LiveCheck(log.period)
    assert rows_of(*live.add(log), *live.rest()).is_same(log)


def test_the_live_check_tells_an_end_stop_by_the_ends_of_all_rows_so_far():
    """As a whole log does, but for rows of a stop that has not been left yet."""
    rng, t = np.random.default_rng(1), 0.01 * np.arange(3000)
    theta = 0.2 * np.sin(0.7 * t) + 1e-3 * rng.normal(size=3000)
    rate = np.cumsum(rng.normal(size=3000)) * 1e-3
    whole = log_of({"t": t, "theta": np.minimum(theta, 0.19), "theta_dot": rate, "beta": 1e-3 * rng.normal(size=3000)})
    live = LiveCheck(0.01)
    seen = rows_of(*live.add(whole), *live.rest())
    left_out, at_stop = ~np.isfinite(seen.theta), ~np.isfinite(checked(whole).log.theta)
    assert not (left_out & ~at_stop).any() and np.count_nonzero(left_out) > 0.95 * np.count_nonzero(at_stop) > 300
