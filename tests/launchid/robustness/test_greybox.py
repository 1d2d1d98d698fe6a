"""The grey box: factors against the tables, the range holds the share it promises, the command."""

import math

import numpy as np
import pytest

import launchid
from launchid.cli.main import main
from launchid.log.log import Log, flown_log
from launchid.robustness import greybox as gb
from sim.flight import dispersion, fly_whole
from sim.nominal import built_in, load_nominal

FLIGHTS = 30


@pytest.mark.parametrize(("probability", "degrees", "value"), [  # Abramowitz & Stegun, table 26.8
    (0.05, 1, 0.00393214), (0.05, 10, 3.94030), (0.05, 30, 18.4926), (0.95, 5, 11.0705), (0.99, 100, 135.807)])
def test_chi_square_quantiles_are_the_tables(probability, degrees, value):
    assert gb.chi_square_quantile(probability, degrees) == pytest.approx(value, rel=1e-5)


@pytest.mark.parametrize(("n", "rank"), [(58, 0), (59, 1), (92, 1), (93, 2), (123, 2), (124, 3)])
def test_order_statistics_of_95_95_are_wilks(n, rank):
    """One-sided 95/95: 59, 93, 124 (Wilks 1941; the nuclear industry's table)."""
    assert gb.wilks_rank(n, 0.95, 0.95) == rank


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


@pytest.mark.parametrize(("words", "status", "mention"), [
    (["constant"], 2, "LOG.csv"), (["missing.csv", "constant"], 3, "missing.csv"),
    (["0.csv", "missing.toml"], 3, "missing.toml"), (["0.csv", "constant", "--share", "1"], 2, "--share")])
def test_faults_are_one_line(tmp_path, capsys, monkeypatch, words, status, mention):
    monkeypatch.chdir(tmp_path)
    launchid.simulate("constant", period=0.1).write("0.csv")
    assert main(["fit-lft", *words, "--out", "never.toml"]) == status
    err = capsys.readouterr().err
    assert len(err.splitlines()) == 1 and mention in err
    assert not (tmp_path / "never.toml").exists()
