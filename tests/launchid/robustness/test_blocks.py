"""Every law, filter, servo and part of the plant in the frozen loop, of `loops` and of `lft`: python-control's."""

import dataclasses
import math

import control_loops
import numpy as np
import pytest
from every import every
from test_mu import check

import launchid
from launchid.controller.law import law_of
from launchid.controller.replay import replay, rms
from launchid.log.log import flown_log
from launchid.robustness.airframe import frozen
from launchid.robustness.lft import lft_at, loop_gain, sample
from launchid.robustness.loops import loops
from launchid.robustness.margins import margins
from sim.effects import effect
from sim.errors import InputError
from sim.flight import fly_whole
from sim.nominal import Controller, Drift, Nominal, load_nominal
from sim.sections import Actuator, Bending, Slosh, constant, lowpass, notch

PERIOD = 0.01
OMEGA = np.array([0.3, 1.0, 3.0, 6.0, 15.0, 18.5, 40.0, 120.0])  # rad/s
PLAIN = load_nominal("constant")
FLEXIBLE = load_nominal("cr826_max_q")
FILTERS = (notch(PERIOD, 30.0, 0.05, 0.5), lowpass(PERIOD, 60.0, 0.7))
PI = Controller(kp=0.6, kd=0.0, derivative_time_constant=0.0, period=PERIOD, law="rate", ki=1.4)
GYRO = Controller(kp=1.2, kd=0.5, derivative_time_constant=0.0, period=PERIOD, law="gyro")
LAG = Actuator(time_constant=0.03, command_noise_std=7e-4, deflection_limit=0.12)
MODES = {"slosh": (Slosh(constant(3.5), constant(0.05), constant(0.01)),),
         "bending": (Bending(constant(18.5), constant(0.02), constant(0.01), constant(0.03)),)}


def with_(**sections) -> Nominal:
    return dataclasses.replace(PLAIN, **sections)


def short(nominal: Nominal, seconds: float = 12.0) -> Nominal:
    return dataclasses.replace(nominal, simulation=dataclasses.replace(nominal.simulation, duration=seconds))


def caused(name: str, **values: float) -> Nominal:
    return with_(effects=(effect(name, **values),))


CASES = {
    "PD": PLAIN,
    "a servo of first order": with_(actuator=LAG),
    "a delay": with_(actuator=dataclasses.replace(PLAIN.actuator, delay=0.03)),
    "PI of the rate": with_(controller=PI),
    "PI of the rate with filters": with_(controller=dataclasses.replace(PI, filters=FILTERS)),
    "P of the rate": with_(controller=dataclasses.replace(PI, ki=0.0)),
    "PD on the gyro": with_(controller=GYRO),
    "PD on the gyro with filters behind a lag": with_(controller=dataclasses.replace(GYRO, filters=FILTERS),
                                                      actuator=LAG),
    "filters": with_(controller=dataclasses.replace(PLAIN.controller, filters=FILTERS)),
    "modes": with_(**MODES),
    "modes, PI of the rate": with_(**MODES, controller=PI),
    "modes, PD on the gyro": with_(**MODES, controller=GYRO),
    "two sloshes and bending, and a notch": FLEXIBLE,
    "drift": with_(drift=Drift(np.zeros(1), np.full(1, 0.03), np.full(1, 0.05))),
    "drift as an effect": caused("lateral_drift", z_alpha=0.03, z_beta=0.05),
    "damping": caused("aero_damping", coefficient=0.4),
    "a term": caused("missing_term", term="theta_dot", coefficient=-0.3),
    "a term's slope": caused("missing_term", term="sin(theta)", coefficient=0.5),
    "a nozzle's inertia": caused("nozzle_inertia", coefficient=0.002),
    "a wash-out": caused("input_washout", time_constant=8.0),
    "a lag before the servo": caused("actuator_bandwidth", scale=0.5, lag=1.0),
    "gains": caused("controller_mismatch", kp_scale=1.2, kd_scale=0.8, delay=0.02),
    "a gyro's scale": with_(controller=GYRO, effects=(effect("gyro_scale", scale=1.1),)),
}


@every("name", list(CASES))
def test_loop_is_python_control_s(name):
    """In `loops` and, at several delta, in `lft`."""
    nominal = CASES[name]
    for delta in ((0.0, 0.0), (0.8, -0.6)):
        lft = lft_at(nominal, 0.0)
        a6, k1 = (float(x) for x in lft.parameters(np.array(delta)))
        expected = control_loops.loop_gain(nominal, a6, k1, OMEGA)
        plant, law = frozen(nominal, 0.0, a6, k1)
        for mine in (loops(plant, law).gain(OMEGA)[0], loop_gain(sample(lft, np.array(delta)), OMEGA)):
            assert np.allclose(mine, expected, rtol=2e-6, atol=1e-12), (delta, np.abs(mine / expected - 1.0))


@every("name", ["PD", "PI of the rate with filters", "PD on the gyro with filters behind a lag", "drift",
                "two sloshes and bending, and a notch", "a wash-out", "modes, PI of the rate"])
def test_both_ways_tell_the_same_stability_and_margins(name):
    nominal = CASES[name]
    lft = lft_at(nominal, 0.0)
    mine, many = margins(lft), loops(*frozen(nominal, 0.0, lft.a6, lft.k1))
    assert bool(mine.stable[0]) == bool(many.stable()[0])
    if mine.stable[0]:
        from launchid.robustness.margin_spread import margin_table
        table = margin_table(many)[0]
        assert mine.gain_low_db[0] == pytest.approx(table[0], rel=1e-5)
        assert (mine.gain_high_db[0], mine.phase_deg[0]) == pytest.approx(tuple(table[1:3]), rel=1e-5)


def test_mu_with_modes_is_what_gridding_finds():
    check(FLEXIBLE, 0.0, (0.0, 0.0), (1.0, 1.0))


@pytest.mark.parametrize("name", ["friction", "attitude_delay", "gyro_delay"])
def test_what_no_loop_has_a_model_of_is_named(name):
    values = {"coefficient": 0.01} if name == "friction" else {"delay": 0.01}
    with pytest.raises(InputError, match=f"effect '{name}': the frozen loop has no model of it; "):
        lft_at(caused(name, **values), 0.0)


# ---- the controller replayed, and margins of its flight


LAWS = {name: CASES[name].controller for name in (
    "PI of the rate with filters", "PD on the gyro", "PD on the gyro with filters behind a lag")}


@every("name", list(LAWS))
def test_law_is_replayed_and_its_gains_are_found(name):
    """From lift-off and from the middle of a log; a flight with other gains is told, and which."""
    nominal = short(with_(controller=LAWS[name]))
    log = flown_log(fly_whole(nominal, 3))
    for part in (log, cut(log, 4.0)):
        found = replay(part, nominal)
        assert not isinstance(found, str), found
        ticks = found.judged(0.0, math.inf)
        assert np.count_nonzero(ticks) > 400 and rms(found.misfit[ticks]) < 1e-9 and not found.contradicts(ticks)
    other = dataclasses.replace(nominal, controller=dataclasses.replace(LAWS[name], kp=1.1 * LAWS[name].kp))
    found = replay(flown_log(fly_whole(other, 3)), nominal)
    ticks = found.judged(0.0, math.inf)
    assert found.contradicts(ticks)
    assert found.explained(ticks).gains[0] == pytest.approx(1.1 * LAWS[name].kp, rel=1e-3)


def cut(log, t: float):
    return dataclasses.replace(log, **{name: x[log.t >= t] for name, x in vars(log).items()
                                       if isinstance(x, np.ndarray) and x.shape == log.t.shape})


def test_a_notch_that_followed_is_replayed_and_judged_where_it_stood():
    """The estimator over the log moves the filter as it did on board; the margins are of the last centre."""
    true = dataclasses.replace(FLEXIBLE, bending=(dataclasses.replace(FLEXIBLE.bending[0], frequency=constant(21.0)),))
    log = flown_log(fly_whole(short(true), 3, believed=short(FLEXIBLE)))
    found = replay(log, FLEXIBLE)
    assert rms(found.misfit[found.judged(0.0, math.inf)]) < 1e-14
    judged = launchid.margins(log, short(FLEXIBLE), window=10.0).windows[-1].window
    centre = judged.controller.controller.filters[0]
    assert math.acos(-centre.b[1] / (centre.b[0] + centre.b[2])) / PERIOD == pytest.approx(21.0, rel=0.01)
    assert judged.valid and judged.spread.stable > 0.95


@pytest.mark.parametrize("first", [6.0, 8.37])
def test_a_notch_that_followed_is_replayed_in_a_log_cut_in_flight(first):
    """There the commands tell where it stood; and another gain is still another gain."""
    true = dataclasses.replace(FLEXIBLE, bending=(dataclasses.replace(FLEXIBLE.bending[0], frequency=constant(21.0)),))
    log = cut(flown_log(fly_whole(short(true), 3, believed=short(FLEXIBLE))), first)
    found = replay(log, FLEXIBLE)
    ticks = found.judged(0.0, math.inf)
    assert np.count_nonzero(ticks) > 200 and rms(found.misfit[ticks]) < 0.5 * found.tolerance
    assert not found.contradicts(ticks)
    own = FLEXIBLE.controller
    for kp, kd in ((1.03, 1.0), (1.0, 0.97)):
        other = replay(log, dataclasses.replace(FLEXIBLE, controller=dataclasses.replace(own, kp=kp * own.kp,
                                                                                         kd=kd * own.kd)))
        assert other.contradicts(other.judged(0.0, math.inf))


def test_the_law_of_a_controller_is_what_the_gains_say():
    assert law_of(GYRO).gains() == pytest.approx({"kp": 1.2, "kd": 0.5})
    assert law_of(PI).gains() == pytest.approx({"kp": 0.6, "ki": 1.4})
