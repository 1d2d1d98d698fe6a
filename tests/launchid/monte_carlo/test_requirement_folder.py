"""A campaign: its flights, its folder, and the proof of a requirement.

The folder has the same bytes whoever flew it and however often it was interrupted; parts are merged. The proof has the
numbers of the literature, and a confidence that holds under stopping.
"""

import dataclasses
import functools
import json
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from every import every
from scipy.stats import beta, binom
from shortened import short

import launchid
from launchid.commands.campaign import campaign, foreseen
from launchid.main import main
from launchid.monte_carlo.requirement.flight import METRICS, Flyer, flight_jobs
from launchid.monte_carlo.requirement.grammar import requirement
from launchid.monte_carlo.requirement.sequential import Count, Planned, Sequential, wilks_rank
from sim.errors import InputError, UsageError
from sim.flight import fly_whole
from sim.nominal import Nominal, Offsets, Profile, Sensors, Wind, load_nominal, write_nominal
from sim.plant import dispersion

PROBABILITY, CONFIDENCE = 0.00135, 0.9   # of Hanson & Beard: 99.865 % with 10 % consumer's risk


# ---- a planned number of flights


@pytest.mark.parametrize(("share", "confidence", "flights"), [
    (0.99865, 0.9, [1705, 2880]),   # Hanson & Beard, NASA/TP-2010-216447
    (0.95, 0.95, [59, 93, 124]),    # Wilks 1941; Guba, Makai & Pal, Reliability Engineering & System Safety 80, 2003
    (0.95, 0.9, [45, 77]),          # success runs, tables of zero- and one-failure demonstration tests
    (0.9, 0.9, [22, 38])])
def test_plans_of_the_literature(share, confidence, flights):
    rule = Planned(1.0 - share, confidence)
    assert [rule.flights_needed(failures) for failures in range(len(flights))] == flights
    for failures, n in enumerate(flights):
        assert rule.is_met(n, failures) and not rule.is_met(n - 1, failures) and not rule.is_met(n, failures + 1)
        assert wilks_rank(n, share, confidence) == failures + 1 and rule.allowed(n) == failures


@pytest.mark.parametrize(("n", "failures"), [(1, 0), (1, 1), (10, 0), (10, 4), (10, 10), (1705, 0), (5000, 12)])
def test_its_bounds_are_clopper_and_pearsons(n, failures):
    low, high = Planned(0.1, 0.9).bounds(n, failures)
    assert high == (pytest.approx(beta.ppf(0.9, failures + 1, n - failures), rel=1e-9) if failures < n else 1.0)
    assert low == (pytest.approx(beta.ppf(0.1, failures, n - failures + 1), rel=1e-9) if failures > 0 else 0.0)
    for probability in (0.5 * low, 1.5 * low, 0.99 * high, min(1.01 * high, 0.999)):
        if 0.0 < probability < 1.0:
            rule = Planned(probability, 0.9)
            assert rule.is_met(n, failures) == (probability > high)
            assert rule.is_refuted(n, failures) == (probability < low)


# ---- a rule that may stop


@functools.cache
def needed(failures: int) -> int:
    return Sequential(PROBABILITY, CONFIDENCE).flights_needed(failures)


def stopped(p: float, most: int, rng: np.random.Generator) -> tuple[str, int, int]:
    """(verdict, flights, failures) of a campaign of at most so many flights that fail with p, drawn as waits."""
    rule, n = Sequential(PROBABILITY, CONFIDENCE), 0
    for failures in range(most):
        fails_at = n + int(rng.geometric(p))
        if min(fails_at - 1, most) >= needed(failures):
            return "met", max(needed(failures), n), failures
        if fails_at > most:
            return "undecided", most, failures
        n = fails_at
        if rule.is_refuted(n, failures + 1):
            return "not met", n, failures + 1
    raise AssertionError


@pytest.mark.parametrize("p", [0.25, 0.5, 1.0, 2.0, 4.0])
def test_thousand_campaigns_that_stop_say_what_is_wrong_no_more_often_than_they_may(p):
    """Verdicts, and both bounds at the flight where it stopped: each wrong in at most 10 % of 1,000 campaigns."""
    true, rng = p * PROBABILITY, np.random.default_rng(16)
    ends = [stopped(true, 20_000, rng) for _ in range(1000)]
    wrong = {"met": 1.0 <= p, "not met": p <= 1.0}
    for verdict, is_wrong in wrong.items():
        if is_wrong:
            assert sum(end[0] == verdict for end in ends) <= 100, verdict
    at_truth = Sequential(true, CONFIDENCE)
    assert sum(at_truth.is_met(n, failures) for _, n, failures in ends) <= 100, "upper bounds below the truth"
    assert sum(at_truth.is_refuted(n, failures) for _, n, failures in ends) <= 100, "lower bounds above the truth"
    decided = np.mean([end[0] != "undecided" for end in ends])
    assert decided > {0.25: 0.98, 0.5: 0.7, 1.0: 0.0, 2.0: 0.7, 4.0: 0.98}[p], "and it does decide"


def exact_wrong(boundary: list[int], most: int) -> float:
    """Probability that a campaign of vehicles at the asked probability ever has k failures or fewer at boundary[k]."""
    at = np.array([1.0])    # of 0, 1, ... failures and no verdict, just after the last look
    wrong, n = 0.0, 0
    for allowed, look in enumerate(boundary):
        if look > most:
            break
        new = np.convolve(at, np.exp(binom.logpmf(np.arange(400), look - n, PROBABILITY)))
        wrong += float(np.sum(new[:allowed + 1]))
        new[:allowed + 1] = 0.0
        at, n = new, look
    return wrong


def test_the_risk_of_a_wrong_met_is_what_it_may_be_exactly():
    """The whole path, not a sample of it; and what looking without the right to look would risk."""
    honest = exact_wrong([needed(k) for k in range(60)], 50_000)
    assert 0.07 < honest <= 0.1
    plan = Planned(PROBABILITY, CONFIDENCE)
    assert exact_wrong([plan.flights_needed(k) for k in range(60)], 50_000) > 0.3, "a plan looked at all the time"
    assert exact_wrong([1705], 1705) == pytest.approx(0.1, rel=1e-2)


@every("confidence", [0.5, 0.9, 0.99])
@every(("n", "failures"), [(1, 0), (1, 1), (10, 3), (300, 0), (300, 1), (300, 299), (20_000, 40)])
def test_bounds_and_verdicts_are_one(n, failures, confidence):
    """The upper bound is below p when, and only when, p is proved; the lower likewise."""
    low, high = Sequential(0.1, confidence).bounds(n, failures)
    assert 0.0 <= low <= failures / n <= high <= 1.0
    for probability in np.geomspace(1e-9, 0.999, 40).tolist():
        rule = Sequential(probability, confidence)
        assert rule.is_met(n, failures) == (probability >= high)
        assert rule.is_refuted(n, failures) == (probability <= low)
    plan_low, plan_high = Planned(0.1, confidence).bounds(n, failures)
    assert low <= plan_low and high >= plan_high, "looking is not free"


# ---- counting


ROW = {"lost": 0, **dict.fromkeys(METRICS, 0.1), "end": 1.0}
LOST = {**ROW, "lost": 1}


def test_a_flight_without_a_result_speaks_for_nobody():
    def verdict(error: str | None, others: object, n: int) -> str:
        count = Count(requirement("lost<0.1@0.9"), Planned(0.1, 0.9))
        for outcome in [*[error] * (error is not None), *[others] * n]:
            count.take(outcome)
        count.look()
        return count.verdict
    assert verdict(None, ROW, 22) == "met" and verdict("KeyError: x", ROW, 22) == "undecided"
    assert verdict("KeyError: x", ROW, 37) == "met", "as if it had failed: 38 flights with one failure"
    assert verdict(None, LOST, 1) == "not met"
    assert verdict("KeyError: x", ROW, 0) == "undecided", "and not as if it had failed"


def test_a_flight_that_is_lost_or_no_number_fails_whatever_is_asked():
    asked = requirement("max_alpha<0.2:0.99@0.9")
    assert not asked.fails(ROW) and asked.fails(LOST)
    assert asked.fails({**ROW, "max_alpha": 0.2}) and asked.fails({**ROW, "max_alpha": math.nan})


# ---- words


def test_a_requirement_as_text():
    asked = requirement(" max_beta_rate < 3e-1 : 0.99865 @ .9 ")
    assert (asked.metric, asked.limit, asked.probability, asked.confidence) == ("max_beta_rate", 0.3, 0.00135, 0.9)
    assert requirement("lost<0.00135@0.9").probability == 0.00135
    assert {"lost", *METRICS} == {"lost", "max_theta_error", "max_theta_dot", "max_alpha", "max_beta", "max_beta_rate"}


@every(("text", "said"), [
    ("", "expected lost<PROBABILITY@CONFIDENCE"), ("lost", "expected"), ("lost>0.1@0.9", "expected"),
    ("lost<0.1", "expected"), ("lost<0.1:0.9@0.9", "expected"),
    ("max_beta<0.1@0.9", "METRIC<VALUE:SHARE@CONFIDENCE"), ("max_gamma<0.1:0.9@0.9", "max_gamma is not measured"),
    ("lost<1@0.9", "the probability 1: expected between 0 and 1"), ("lost<0@0.9", "the probability 0"),
    ("lost<0.1@1.0", "the confidence 1.0"), ("lost<-0.1@0.9", "the probability -0.1"),
    ("max_beta<0.1:1.5@0.9", "the share 1.5"), ("max_beta<-1:0.5@0.9", "above 0 rad"), ("lost<nan@0.9", "expected"),
    ("lost<0.1@0.9\nlost", "expected"), ("x" * 5000, "..."), ("lost<1e-400@0.9", "the probability 1e-400"),
    ("max_beta<1e999:0.5@0.9", "above 0 rad"), ("lost<0.٣@0.9", "expected")])
def test_a_wrong_text_is_one_line(tmp_path, capsys, text, said):
    out = tmp_path / "out"
    assert main(["campaign", "constant", "--flights", "10", "--out", str(out), f"--requirement={text}"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line and "--requirement" in line and len(line) < 400
    assert not out.exists()


@pytest.mark.parametrize(("words", "status", "said"), [
    ([], 2, "expected --flights N, or --merge"), (["--flights", "0"], 2, "--flights 0"),
    (["--flights", "5", "--seed", "-1"], 2, "--seed -1"), (["--flights", "5", "--workers", "0"], 2, "--workers 0"),
    (["--flights", "5", "--executor", "slurm"], 2, "expected local, or dask:ADDRESS"),
    (["--flights", "5", "--executor", "dask:"], 2, "dask:ADDRESS"),
    (["--flights", "5", "--merge", "x"], 2, "one of them"), (["--merge", "nowhere"], 3, "nowhere/campaign.json")])
def test_wrong_words_are_one_line(tmp_path, capsys, words, status, said):
    out = tmp_path / "out"
    assert main(["campaign", "constant", "--out", str(out), *words]) == status
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line and not out.exists()


ROOT = Path(__file__).resolve().parents[3]


# ---- a flight


def nominal_of(folder: Path, duration: float = 0.5, **sections: object) -> Nominal:
    """`constant`, short, at half of its rate, as a file in this folder."""
    write_nominal(short(duration, simulation={"step": 0.002}, **sections), folder / "n.toml")
    return load_nominal(folder / "n.toml")


def test_peaks_are_those_of_the_whole_flight_at_every_step(tmp_path):
    """Sensors without noise, so that the log is the truth but for the bias that the attitude sensor has."""
    nominal = nominal_of(tmp_path, 12.0, sensors=Sensors(0.01, 0.0, 0.0, 0.0), wind=Wind(walk=0.01, turbulence=0.01),
                         offsets=Offsets(attitude_bias=0.02, thrust_misalignment=0.003))
    (job,) = flight_jobs(nominal, 7, 1)
    row = Flyer(nominal)(job)
    flight = fly_whole(nominal, 7, period=0.002, a6_factor=dispersion(nominal, *job[1:])[0],
                       k1_factor=dispersion(nominal, *job[1:])[1])
    bias = row["offset_attitude_bias"]
    assert bias == flight.offsets["attitude_bias"] != 0.0 and row["offset_thrust_misalignment"] != 0.0
    theta = flight.theta - bias
    expected = (theta - flight.theta_ref, flight.theta_dot, theta - flight.true_gamma + flight.wind, flight.beta)
    found = [row[name] for name in ("max_theta_error", "max_theta_dot", "max_alpha", "max_beta")]
    np.testing.assert_allclose(found, [np.max(np.abs(x)) for x in expected], rtol=1e-12)
    np.testing.assert_allclose(row["max_beta_rate"], np.max(np.abs(np.diff(flight.beta))) / 0.002, rtol=0.02)
    assert (row["lost"], row["end"]) == (0, 12.0)


def unstable(folder: Path) -> Nominal:
    """A loop of which some vehicles of the box are lost within 3 s."""
    return nominal_of(folder, 3.0, vehicle=Profile(np.zeros(1), np.array([9.0]), np.array([-7.0])),
                      offsets=Offsets(attitude_bias=0.05))


# ---- a folder


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


WHOLE = {"campaign.json", "flights.csv", "verdict.json"}


def test_one_and_two_workers_write_the_same_bytes_and_stop_at_the_same_flight(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    nominal_of(tmp_path)
    words = ["campaign", str(tmp_path / "n.toml"), "--flights", "2000", "--requirement", "lost<0.05@0.9",
             "--requirement", "max_beta<0.1:0.9@0.95"]
    for workers in ("1", "2"):
        assert main([*words, "--workers", workers, "--out", str(tmp_path / workers)]) == 0
    assert files(tmp_path / "1") == files(tmp_path / "2") and set(files(tmp_path / "1")) == WHOLE | {"campaign.png"}
    report = json.loads((tmp_path / "1" / "verdict.json").read_text())
    expected = Sequential(0.05, 0.9).flights_needed(0)
    assert report["verdict"] == "met" and report["flights"] == 2000
    assert report["flown"] == expected == len((tmp_path / "1" / "flights.csv").read_text().splitlines()) - 1
    said = capsys.readouterr().out
    assert f"MET after {expected} flights" in said and "no more were needed" in said


def test_interrupted_and_continued_is_the_same_folder(tmp_path):
    nominal = nominal_of(tmp_path)
    asked = ["lost<0.02@0.9", "max_beta<0.1:0.98@0.9"]
    whole = campaign(nominal, out=tmp_path / "whole", flights=400, requirement=asked, stop="never", workers=1)

    class Stop(Exception):
        """An exception in the place of Ctrl-C."""

    done = 0

    def progress(newly: int) -> None:
        nonlocal done
        done += newly
        if done >= 100:
            raise Stop

    with pytest.raises(Stop):
        campaign(nominal, out=tmp_path / "parts", flights=400, requirement=asked, stop="never", workers=2,
                 progress=progress)
    assert set(files(tmp_path / "parts")) == {"campaign.json", "flights.csv.journal"}, "nothing half written"
    seen: list[int] = []
    made = campaign(nominal, out=tmp_path / "parts", flights=400, requirement=asked, stop="never", workers=2,
                    progress=seen.append)
    assert seen[0] >= 100 and sum(seen) == 400
    assert files(tmp_path / "parts") == files(tmp_path / "whole")
    assert made.report == whole.report and whole.report["flown"] == 400
    (tmp_path / "parts" / "verdict.json").unlink()
    again = campaign(nominal, out=tmp_path / "parts", flights=400, requirement=asked, stop="never",
                     progress=lambda _: pytest.fail("it was flown already"))
    assert again.report == whole.report and files(tmp_path / "parts") == files(tmp_path / "whole")


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_ctrl_c_is_one_exit_status_and_the_same_command_goes_on(tmp_path):
    nominal_of(tmp_path, 10.0)
    words = [sys.executable, "-m", "sim", "campaign", str(tmp_path / "n.toml"), "--flights", "400", "--workers", "1",
             "--out", str(tmp_path / "out")]
    journal = tmp_path / "out" / "flights.csv.journal"
    ignoring = signal.getsignal(signal.SIGINT)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a background shell's children ignore it
    try:
        with subprocess.Popen(words, cwd=ROOT, stderr=subprocess.PIPE, text=True) as process:
            while process.poll() is None and not (journal.exists() and journal.read_bytes().count(b"\n") > 20):
                time.sleep(0.02)
            process.send_signal(signal.SIGINT)
            said = process.stderr.read()
    finally:
        signal.signal(signal.SIGINT, ignoring)
    assert process.returncode == 130 and "Traceback" not in said
    assert "flights are kept; the same command goes on from there" in said
    assert set(files(tmp_path / "out")) == {"campaign.json", "flights.csv.journal"}
    kept = journal.read_bytes().count(b"\n") - 1
    seen: list[int] = []
    campaign(load_nominal(tmp_path / "n.toml"), out=tmp_path / "out", flights=400, workers=2, progress=seen.append)
    assert seen[0] == kept >= 20 and set(files(tmp_path / "out")) == WHOLE


@pytest.mark.parametrize("other", [{"flights": 21}, {"seed": 1}, {"requirement": "lost<0.1@0.9"}, {"stop": "never"}])
def test_another_campaign_s_folder_is_refused(tmp_path, other):
    nominal = nominal_of(tmp_path)
    campaign(nominal, out=tmp_path / "out", flights=20, workers=1)
    before = files(tmp_path / "out")
    with pytest.raises(InputError, match="another campaign's folder"):
        campaign(nominal, **{"out": tmp_path / "out", "flights": 20, **other})
    with pytest.raises(InputError, match="nominal_sha256"):
        campaign(nominal_of(tmp_path, 0.6), out=tmp_path / "out", flights=20)
    assert files(tmp_path / "out") == before


# ---- parts


def test_merged_parts_are_the_campaign_of_all_seeds(tmp_path):
    nominal = nominal_of(tmp_path)
    asked = ["lost<0.02@0.9", "max_beta<0.05:0.9@0.9"]
    for first in (0, 50, 100):
        campaign(nominal, out=tmp_path / f"part{first}", flights=50, seed=first, workers=1)
    campaign(nominal, out=tmp_path / "whole", flights=150, requirement=asked, stop="never", workers=1)
    parts = [tmp_path / f"part{first}" for first in (100, 0, 50)]
    campaign(nominal, out=tmp_path / "merged", merge=parts, requirement=asked, stop="never")
    assert files(tmp_path / "merged") == files(tmp_path / "whole")
    sequential = campaign(nominal, out=tmp_path / "sequential", merge=parts, requirement=asked)
    assert sequential.report["flown"] == 150 and sequential.report["results"][0]["decided_at"] is not None

    with pytest.raises(InputError, match=r"seeds from 50 to 99 are missing"):
        campaign(nominal, out=tmp_path / "x", merge=[parts[0], parts[1]])
    with pytest.raises(InputError, match=r"seeds from 0 to 49 stand twice"):
        campaign(nominal, out=tmp_path / "x", merge=[*parts, parts[1]])
    (parts[2] / "flights.csv").rename(parts[2] / "flights.csv.journal")
    with pytest.raises(InputError, match="not flown to its end"):
        campaign(nominal, out=tmp_path / "x", merge=parts)
    with pytest.raises(InputError, match="part of another campaign"):
        campaign(nominal_of(tmp_path, 0.6), out=tmp_path / "x", merge=parts)
    campaign(nominal, out=tmp_path / "stopped", flights=200, requirement="lost<0.1@0.9", workers=1)
    with pytest.raises(InputError, match="a part is flown whole"):
        campaign(nominal, out=tmp_path / "x", merge=[tmp_path / "stopped"])
    assert not (tmp_path / "x").exists()


# ---- before the first flight


def test_a_nominal_that_cannot_fly_is_said_before_anything_is_written(tmp_path, capsys):
    short = nominal_of(tmp_path)
    assert short.simulation is not None
    odd = dataclasses.replace(short, simulation=dataclasses.replace(short.simulation, step=0.003))
    write_nominal(odd, tmp_path / "odd.toml")
    assert main(["campaign", str(tmp_path / "odd.toml"), "--flights", "5", "--out", str(tmp_path / "out")]) == 3
    assert "expected a whole number of simulation steps" in capsys.readouterr().err
    assert main(["campaign", "pendulum_linear", "--flights", "5", "--out", str(tmp_path / "out")]) == 3
    assert not (tmp_path / "out").exists()


def test_too_few_flights_are_said_before_they_are_flown(tmp_path, capsys):
    """The literature's 1,705 flights prove nothing if the campaign may stop; as a plan they do."""
    nominal = nominal_of(tmp_path)
    said = foreseen(nominal, 1705, "lost<0.00135@0.9", "decided")
    assert said == ("lost<0.00135@0.9: 1705 flights cannot prove it, 2210 without a failure would; with --stop "
                    "never 1705 would",)
    assert foreseen(nominal, 1705, "lost<0.00135@0.9", "never") == ()
    assert "1705 without" in foreseen(nominal, 1704, "lost<0.00135@0.9", "never")[0]
    words = ["campaign", str(tmp_path / "n.toml"), "--flights", "5", "--workers", "1", "--out", str(tmp_path / "o")]
    assert main([*words, "--requirement", "lost<0.00135@0.9"]) == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("lost<0.00135@0.9: 5 flights cannot prove it")
    with pytest.warns(launchid.DataWarning, match="5 flights cannot prove it"):
        launchid.campaign(nominal, out=tmp_path / "o", flights=5, requirement="lost<0.00135@0.9", workers=1)


# ---- the verdict


def test_order_statistics_of_a_table_are_numpys(tmp_path):
    """59 flights: the largest is above the 95 % quantile with 95 % confidence (Wilks); of 93 the second largest."""
    nominal = nominal_of(tmp_path)
    for n, rank in ((59, 1), (93, 2), (58, None)):
        made = campaign(nominal, out=tmp_path / f"{n}", flights=n, requirement="max_alpha<0.1:0.95@0.95",
                        stop="never", workers=1)
        known = made.report["results"][0]["quantile"]
        values = np.sort(made.columns()["max_alpha"])
        assert known["rank_from_largest"] == rank
        assert known["value"] == (None if rank is None else values[-rank])
        assert made.report["metrics"]["max_alpha"]["largest"] == values[-1]
    assert made.verdict == "undecided" and made.report["results"][0]["flights_needed"] == 59
    assert "have been a plan" in made.summary()


def test_lost_flights_refute_and_are_beyond_every_order_statistic(tmp_path):
    nominal = unstable(tmp_path)
    made = campaign(nominal, out=tmp_path / "out", flights=300, workers=1,
                    requirement=["lost<0.01@0.9", "max_theta_dot<5:0.99@0.9"])
    assert made.verdict == "not met" and made.report["flown"] < 300 and made.report["lost"] > 0
    assert all(result["lower"] > 0.01 and result["verdict"] == "not met" for result in made.report["results"])
    assert made.report["results"][1]["quantile"]["value"] is None
    assert "NOT MET after" in made.summary()


def test_without_a_requirement_nothing_is_claimed(tmp_path, capsys):
    nominal_of(tmp_path, uncertainty=None)
    words = ["campaign", str(tmp_path / "n.toml"), "--flights", "8", "--workers", "1", "--out", str(tmp_path / "o")]
    assert main(words) == 0
    said = capsys.readouterr()
    assert "no [uncertainty]: every flight is of the nominal a6 and k1" in said.err
    assert "max_alpha: median" in said.out
    assert json.loads((tmp_path / "o" / "verdict.json").read_text())["verdict"] is None


def test_from_python_it_is_the_command(tmp_path, capsys):
    nominal_of(tmp_path)
    words = ["--flights", "30", "--requirement", "lost<0.1@0.9", "--workers", "1", "--seed", "4"]
    assert main(["campaign", str(tmp_path / "n.toml"), *words, "--out", str(tmp_path / "a")]) == 0
    made = launchid.campaign(tmp_path / "n.toml", out=tmp_path / "b", flights=30, requirement="lost<0.1@0.9",
                             workers=1, seed=4)
    assert made.summary(str(tmp_path / "a")) + "\n" == capsys.readouterr().out
    assert {name: text for name, text in files(tmp_path / "a").items() if name != "campaign.png"} == \
        files(tmp_path / "b")
    assert made.columns()["seed"] == list(range(4, 4 + made.report["flown"])) and made.verdict == "met"
    with pytest.raises(UsageError, match=r"^stop 'sometimes'"):
        launchid.campaign(tmp_path / "n.toml", out=tmp_path / "c", flights=3, stop="sometimes")


# ---- beyond one machine


def test_a_dask_scheduler_gives_the_same_bytes(tmp_path):
    distributed = pytest.importorskip("distributed", reason="distributed (extra `cluster`) is not installed")
    nominal = nominal_of(tmp_path)
    campaign(nominal, out=tmp_path / "here", flights=500, requirement="lost<0.05@0.9", workers=1)
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None) as made:
        campaign(nominal, out=tmp_path / "there", flights=500, requirement="lost<0.05@0.9",
                 executor=f"dask:{made.scheduler_address}")
    assert files(tmp_path / "here") == files(tmp_path / "there")
