"""Margins of the loop that flew: the controller replayed on the log, the servo asked in every window."""

import re
from dataclasses import replace

import numpy as np
import pytest
from shortened import short

import launchid
from launchid.controller.replay import Replay, replay, rms
from launchid.robustness.blocks import plants_of
from launchid.robustness.loops import loops
from launchid.robustness.margin_spread import MARGIN_NAMES, margin_table
from launchid.robustness.servo_check import contradictions, followed
from launchid.sources import read_log
from sim.effects import effect
from sim.nominal import Nominal, Section
from sim.onboard import onboard_model

CONSTANT = short(30.0)
PD = CONSTANT.controller
RATE = replace(CONSTANT, controller=replace(PD, law="rate", kp=0.5, ki=1.2, kd=0.0, derivative_time_constant=0.0))
FILTERED = replace(CONSTANT, controller=replace(PD, filters=(Section((0.2, 0.0, 0.0), (1.0, -0.8, 0.0)),)))
COLUMNS = ("t", "theta_ref", "beta_cmd", "beta", "theta", "theta_dot")


def flown(nominal: Nominal, seed: int = 1, **how) -> dict[str, np.ndarray]:
    """The columns of a flight."""
    log = read_log(launchid.simulate(nominal, seed=seed, **how))
    return {name: x.copy() for name, x in log.measured().items()}


def replayed(columns: dict[str, np.ndarray], nominal: Nominal = CONSTANT) -> Replay:
    found = replay(read_log(columns), nominal)
    assert not isinstance(found, str), found
    return found


# ---- the controller


@pytest.mark.parametrize("nominal", [CONSTANT, RATE, FILTERED], ids=["attitude", "rate", "filtered"])
@pytest.mark.parametrize("period", [0.01, 0.002])
@pytest.mark.parametrize("first", [0, 1234], ids=["from the start", "from within"])
def test_the_replay_is_the_simulators_own_command(nominal, period, first):
    """To rounding, or to what filters still remember of before the log; whichever row of a period is the first."""
    columns = {name: x[first:] for name, x in flown(nominal, period=period).items()}
    found = replayed(columns, nominal)
    told = np.isfinite(found.misfit)
    assert np.mean(told) > 0.9 and rms(found.misfit[told]) < (1e-15 if nominal is not FILTERED else 3e-7)
    assert not found.contradicts(found.judged(0.0, 30.0))


def test_missing_rows_cost_two_commands_each_and_are_no_misfit():
    columns = flown(CONSTANT)
    lost = np.random.default_rng(0).random(len(columns["t"])) < 0.15
    columns["theta"][lost] = np.nan
    gap = np.ones(len(lost), bool)
    gap[700:900] = False
    found = replayed({name: x[gap] for name, x in columns.items()})
    told = np.isfinite(found.misfit)
    assert np.count_nonzero(told) > 0.65 * len(lost) and rms(found.misfit[told]) < 1e-15


@pytest.mark.parametrize(("kp", "kd", "late"), [(0.8, 1.0, 0.0), (1.0, 0.6, 0.0), (2.0, 0.7, 0.0), (1.0, 1.0, 0.01),
                                                (1.1, 0.9, 0.03), (1.0, 1.01, 0.0), (1.0, 0.9, 0.004)])
def test_another_controller_is_contradicted_and_its_gains_are_found(kp, kd, late):
    found = replayed(flown(CONSTANT, effects=[effect("controller_mismatch", kp_scale=kp, kd_scale=kd, delay=late)]))
    ticks = found.judged(10.0, 15.0)
    assert np.count_nonzero(ticks) == 500 and found.contradicts(ticks)
    told = found.explained(found.judged(0.0, 30.0))
    assert told.gains == pytest.approx([kp * PD.kp, kd * PD.kd], rel=1e-6)
    assert told.delay == pytest.approx(late, abs=1e-6) and told.after < 1e-7 < told.before
    assert f"kp {kp * PD.kp:.4g}, kd {kd * PD.kd:.4g}" in found.words(told) and "would explain" in found.words(told)


def test_another_rate_controller_is_found():
    other = replace(RATE, controller=replace(RATE.controller, kp=0.45, ki=1.5))
    found = replayed(flown(other), RATE)
    told = found.explained(found.judged(0.0, 30.0))
    assert found.contradicts(found.judged(0.0, 5.0)) and told.gains == pytest.approx([0.45, 1.5], rel=1e-6)


@pytest.mark.parametrize("controller", [replace(PD, derivative_time_constant=0.1), replace(PD, period=0.02),
                                        replace(PD, period=0.005), FILTERED.controller],
                         ids=["time constant", "period", "faster", "filter"])
def test_what_no_gains_explain_is_contradicted_too(controller):
    found = replayed(flown(replace(CONSTANT, controller=controller), period=0.01))
    assert found.contradicts(found.judged(0.0, 5.0)) and found.contradicts(found.judged(20.0, 25.0))
    assert "no gains and delay explain them" in found.words(found.explained(found.judged(0.0, 30.0)))


def test_the_rounding_of_a_columns_digits_is_no_other_controller():
    """Four decimals, through the law's gain of noise; the same rounding hides no gain that is 40 % off."""
    columns = flown(CONSTANT)
    columns["theta"] = np.round(columns["theta"], 4)
    found = replayed(columns)
    assert rms(found.misfit[found.judged(0.0, 30.0)]) > CONSTANT.diagnosis.command
    assert not any(found.contradicts(found.judged(t, t + 5.0)) for t in range(0, 30, 5))
    columns = flown(replace(CONSTANT, controller=replace(PD, kd=0.6 * PD.kd)))
    columns["theta"] = np.round(columns["theta"], 4)
    other = replayed(columns)
    assert all(other.contradicts(other.judged(t, t + 5.0)) for t in range(0, 30, 5))


@pytest.mark.parametrize(("period", "drop", "why"), [
    (0.05, (), "0.05 s apart"), (0.01, ("beta_cmd",), "beta_cmd"), (0.01, ("theta_ref",), "theta_ref"),
    (0.007, (), "not at the controller's periods")])
def test_what_cannot_be_replayed_says_why(period, drop, why):
    columns = {name: x for name, x in flown(CONSTANT, period=period).items() if name not in drop}
    found = replay(read_log(columns), CONSTANT)
    assert isinstance(found, str) and why in found


# ---- the servo


def checked(columns: dict[str, np.ndarray], nominal: Nominal = CONSTANT) -> tuple[list[bool | None], object]:
    model = onboard_model(nominal)
    found = followed(read_log(columns), model)
    servo = np.array([model.natural_frequency, model.damping_ratio, model.delay])
    windows = [(t, t + 5.0) for t in range(0, 30, 5)]
    return contradictions(found, windows, [(servo, np.zeros((3, 3)))] * 6).found, found


@pytest.mark.parametrize("period", [0.01, 0.002])
def test_the_servo_that_flew_is_believed(period):
    for seed in range(3):
        assert checked(flown(CONSTANT, seed, period=period))[0] == [False] * 6


SERVO = CONSTANT.actuator


@pytest.mark.parametrize(("servo", "effects"), [
    (replace(SERVO, natural_frequency=40.0), ()), (replace(SERVO, damping_ratio=0.5), ()),
    (replace(SERVO, delay=0.013), ()), (SERVO, (effect("actuator_gain", scale=0.9),)),
    (replace(SERVO, natural_frequency=62.0, damping_ratio=0.9, delay=0.021), ())])
def test_another_servo_is_contradicted_and_found(servo, effects):
    is_other, followed_ = checked(flown(replace(CONSTANT, actuator=servo), effects=list(effects)))
    assert is_other == [True] * 6
    values, std, noise = followed_.own(0.0, 30.0, np.array([50.0, 0.7, 0.0, 1.0]))
    truth = np.array([servo.natural_frequency, servo.damping_ratio, servo.delay, 0.9 if effects else 1.0])
    assert np.all(np.abs(values - truth) < 4.0 * std) and noise == pytest.approx(1.0, abs=0.05)
    assert np.all(std < [1.0, 0.03, 5e-4, 0.03])


def test_play_and_a_row_that_is_late_are_contradicted():
    assert all(checked(flown(CONSTANT, effects=[effect("actuator_backlash", half_width=1e-3)]))[0])
    columns = flown(CONSTANT)
    columns["beta_cmd"] = np.concatenate([columns["beta_cmd"][1:], columns["beta_cmd"][-1:]])
    assert all(checked(columns)[0])


def test_the_innovations_are_white_behind_a_delay_that_parts_the_rows():
    """A Kalman filter's: unit variance, no correlation at any lag, though one command's noise acts in two rows."""
    nominal = replace(CONSTANT, actuator=replace(SERVO, delay=0.013))
    found = checked(flown(nominal), nominal)[1]
    answer = found.answer(0.0, 30.0, np.array([50.0, 0.7, 0.013, 1.0]), np.zeros((3, 3)))
    assert answer.left == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / 3000))


@pytest.mark.parametrize("loud", [0.5, 1.5])
def test_noise_beside_the_declared_is_no_other_servo(loud):
    true = replace(CONSTANT, sensors=replace(CONSTANT.sensors, beta_std=loud * CONSTANT.sensors.beta_std),
                   actuator=replace(SERVO, command_noise_std=SERVO.command_noise_std / loud))
    assert checked(flown(true))[0] == [False] * 6


# ---- the margins


def test_another_controllers_margins_are_its_own_or_none():
    """The law of the log, as accurate as the nominal that flew; with `nominal` none of a controller that did not."""
    columns = flown(replace(CONSTANT, controller=replace(PD, kd=0.3)))
    asked = replace(CONSTANT, controller=replace(PD, kd=0.3))
    truth = margin_table(loops(plants_of(np.array([[2.0, -7.0, 50.0, 0.7, 0.0]])), asked.controller))[0]
    fitted = launchid.margins(columns, CONSTANT)
    assert fitted.report["controller"]["source"] == "log"
    assert fitted.report["controller"]["kd"] == pytest.approx(0.3)
    assert fitted.windows[3].window.spread.phase_deg.value == pytest.approx(truth[2], abs=0.5)   # 27 degrees
    found = launchid.margins(columns, CONSTANT, tracked=True, controller="nominal")
    for each in found.report["windows"]:
        assert each["status"] == each["tracked"]["status"] == "CONTROLLER" and not each["valid"]
        assert all(each[name]["value"] is None for name in MARGIN_NAMES)
    assert "in 6 of 6 windows, from 0 s on, the commands are not the nominal controller's" in found.summary()
    assert "kp 1.2, kd 0.3 would explain them" in found.summary()


def test_windows_of_another_servo_are_model_and_the_sentence_counts_all():
    """Delay 12 ms in place of none from 15 s on: two logs, cut and joined where the vehicle is at rest."""
    early, late = flown(CONSTANT), flown(replace(CONSTANT, actuator=replace(SERVO, delay=0.012)))
    first = early["t"] < 15.0
    joined = {name: np.where(first, early[name], late[name]) for name in COLUMNS}
    joined["t"] = early["t"]
    found = launchid.margins(joined, CONSTANT)
    statuses = [each["status"] for each in found.report["windows"]]
    assert statuses[3:] == ["MODEL"] * 3 and "OK" in statuses[:3]
    n = sum(each["valid"] for each in found.report["windows"])
    assert f"{n} of 6 windows have margins; of those all keep what [margins] requires" in found.summary()
    assert "from 15 s on, the nozzle does not answer the commands as the servo does (MODEL)" in found.summary()
    assert float(re.search(r"delay ([\d.]+) \+-", found.summary())[1]) == pytest.approx(12.0, abs=1.5)


KD_OFF = replace(CONSTANT, controller=replace(PD, kd=0.3))


def without(nominal: Nominal, *names: str) -> dict[str, np.ndarray]:
    return {name: x for name, x in flown(nominal).items() if name not in names}


@pytest.mark.parametrize("kd", [PD.kd, 0.3])
def test_without_a_reference_the_controller_is_fitted(kd):
    """The reference is a few straight lines."""
    asked = replace(CONSTANT, controller=replace(PD, kd=kd))
    found = launchid.margins(without(asked, "theta_ref"), CONSTANT)
    assert found.report["controller"]["source"] == "log" and found.report["controller"]["kd"] == pytest.approx(kd)
    truth = margin_table(loops(plants_of(np.array([[2.0, -7.0, 50.0, 0.7, 0.0]])), asked.controller))[0]
    assert found.windows[3].window.spread.phase_deg.value == pytest.approx(truth[2], abs=0.5)


def test_without_commands_the_nozzle_tells_whether_the_nominals_controller_flew():
    found = launchid.margins(without(CONSTANT, "beta_cmd"), CONSTANT)
    assert all(window["status"] == "OK" for window in found.report["windows"])
    assert any("its nozzle answers them" in each for each in found.report["assumed"])
    late = replace(CONSTANT, actuator=replace(SERVO, delay=0.03))
    for other in (KD_OFF, late):
        found = launchid.margins(without(other, "beta_cmd"), CONSTANT)
        assert all(window["status"] == "UNCHECKED" for window in found.report["windows"])


def test_what_cannot_be_asked_is_unchecked():
    """Neither command nor reference."""
    found = launchid.margins(without(CONSTANT, "beta_cmd", "theta_ref"), CONSTANT)
    assert all(window["status"] == "UNCHECKED" and not window["valid"] for window in found.report["windows"])
    assert "UNCHECKED" in found.summary()


def test_a_row_of_two_tells_another_controller():
    """kd of 0.3 for 0.5: the closed loop's likelihood has the gains, and the margins that flew."""
    found = launchid.margins({name: x[::2] for name, x in flown(KD_OFF).items()}, CONSTANT, window=10.0)
    truth = margin_table(loops(plants_of(np.array([[2.0, -7.0, 50.0, 0.7, 0.0]])), KD_OFF.controller))[0]
    assert found.report["controller"]["kd"] == pytest.approx(0.3, abs=4.0 * found.report["controller"]["kd_std"])
    for window in found.windows:
        margin = window.window.spread.phase_deg
        assert abs(margin.value - truth[2]) < 2.0 * (margin.high - margin.low)


def test_a_declared_controller_is_assumed_and_said():
    """With `nominal` it need not be tested; the servo must."""
    found = launchid.margins(without(CONSTANT, "theta_ref"), CONSTANT, controller="nominal")
    assert found.report["windows"][2]["valid"]
    assert any("controller is the nominal's (not tested: the log has no theta_ref)" in each
               for each in found.report["assumed"])
    _frozen, servo = launchid.margins(flown(CONSTANT), CONSTANT).report["assumed"]
    w, zeta, delay = map(float, re.search(r"below (\S+) rad/s, (\S+) of .* ratio, (\S+) ms", servo).groups())
    assert 0.5 < w < 5.0 and 0.01 < zeta < 0.1 and 0.1 < delay < 5.0


def test_a_servo_that_the_log_hardly_tells_is_as_uncertain_as_that():
    """A nozzle's sensor of 6 mrad: 1 ms of delay would not have shown, and the delay margin's interval says so."""
    loud = replace(CONSTANT, sensors=replace(CONSTANT.sensors, beta_std=6e-3))
    found = launchid.margins(flown(loud), loud)
    delay = found.windows[3].window.known.covariance[4, 4] ** 0.5
    assert delay > loud.diagnosis.timing and "as uncertain as the log leaves it" in found.summary()
    assert launchid.margins(flown(CONSTANT), CONSTANT).windows[3].window.known.covariance[4, 4] == 0.0


def test_a_servo_that_the_first_windows_cannot_test_is_that_of_the_others():
    """Before the first turn nothing told 70 rad/s from 60: the first window had margins of a loop that did not fly."""
    still = replace(CONSTANT, guidance=replace(CONSTANT.guidance, t=(0.0, 12.0, 14.0), theta_ref=(0.0, 0.0, 0.1)),
                    sensors=replace(CONSTANT.sensors, theta_std=2e-5, theta_dot_std=2e-5),
                    actuator=replace(CONSTANT.actuator, command_noise_std=1e-6))
    slow = replace(still, actuator=replace(still.actuator, natural_frequency=0.85 * SERVO.natural_frequency))
    columns = flown(slow)
    assert checked(columns, still)[0] == [True] * 6
    early = {name: x[columns["t"] < 10.0] for name, x in columns.items()}
    assert not any(checked(early, still)[0])


# ---- at large: a window is right within three half-widths, or has no margins


def truth_of(flew: Nominal) -> np.ndarray:
    """The true margins (4,) of `constant` behind what flew."""
    servo = flew.actuator
    row = np.array([[2.0, -7.0, servo.natural_frequency, servo.damping_ratio, servo.delay]])
    return margin_table(loops(plants_of(row), flew.controller))[0]


def wrong_windows(found, truths: list[np.ndarray]) -> list[tuple[float, str]]:
    """(start [s], margin) of windows with margins that are off by more than three half-widths of their interval."""
    return [(window.t_start, name) for window, truth in zip(found.windows, truths, strict=True) if window.window.spread
            for name, x in zip(MARGIN_NAMES, truth, strict=True) for margin in [getattr(window.window.spread, name)]
            if np.isfinite(x) and abs(x - margin.value) > 1.5 * (margin.high - margin.low)]


@pytest.mark.campaign
@pytest.mark.parametrize("other", [
    {"kp": 0.8}, {"kp": 1.2}, {"kp": 2.0}, {"kd": 0.6}, {"kd": 0.7}, {"kd": 1.3}, {"kp": 0.9, "kd": 1.1},
    {"derivative_time_constant": 3.0}, {"late": 0.005}, {"late": 0.01}, {"period": 2.0},
    {"filters": FILTERED.controller.filters}], ids=str)
@pytest.mark.parametrize("seed", [1, 2])
def test_no_window_of_another_controller_is_wrong(other, seed):
    late = other.get("late", 0.0)   # s, of computing time
    flew = replace(CONSTANT, controller=replace(PD, **{
        name: x if name == "filters" else getattr(PD, name) * x for name, x in other.items() if name != "late"}))
    truth = truth_of(replace(flew, actuator=replace(SERVO, delay=SERVO.delay + late)))
    found = launchid.margins(flown(flew, seed, effects=[effect("controller_mismatch", delay=late)] if late else []),
                             CONSTANT)
    assert wrong_windows(found, [truth] * 6) == []
    assert found.report["controller"]["source"] == "log"


@pytest.mark.campaign
@pytest.mark.parametrize("change", [
    {"delay": 0.01}, {"delay": 0.02}, {"delay": 0.03}, {"natural_frequency": 0.7}, {"natural_frequency": 0.5},
    {"damping_ratio": 0.6}], ids=str)
@pytest.mark.parametrize("seed", [1, 2])
def test_no_window_of_a_servo_that_changes_is_wrong(change, seed):
    later = replace(SERVO, **{name: x if name == "delay" else getattr(SERVO, name) * x for name, x in change.items()})
    other = replace(CONSTANT, actuator=later)
    early, late = flown(CONSTANT, seed), flown(other, seed)
    joined = {name: np.where(early["t"] < 15.0, early[name], late[name]) for name in COLUMNS}
    found = launchid.margins(joined, CONSTANT)
    assert wrong_windows(found, [truth_of(CONSTANT)] * 3 + [truth_of(other)] * 3) == []


@pytest.mark.campaign
def test_clean_flights_lose_two_windows_of_a_hundred_at_most():
    lost = windows = 0
    for seed in range(20):
        found = launchid.margins(flown(CONSTANT, seed), CONSTANT)
        lost += sum(each["status"] in ("CONTROLLER", "MODEL") for each in found.report["windows"])
        windows += len(found.windows)
    assert lost <= 0.02 * windows
