"""launchid diagnose on logs that lost rows: what the nozzle was sent meanwhile is not known, and nobody pretends that
it is, neither to the vehicle's model nor to the controller's check."""

import dataclasses
import functools

import numpy as np
import pytest
from test_diagnosis import WHOLE, log_of

from launchid.diagnosis.answer import report
from launchid.diagnosis.verdict import diagnose
from launchid.log.log import OPTIONAL, REQUIRED
from sim.effects import from_text
from sim.flight import fly_whole

NOMINAL = dataclasses.replace(WHOLE, simulation=dataclasses.replace(WHOLE.simulation, duration=30.0))
SINGLE = {"share": 0.03, "long": 1}   # rows lost
BURSTS = {"share": 0.02, "long": 20}


@functools.cache
def flown(effect, seed=1):
    """The log of a flight; shared, so nobody changes it."""
    return log_of(fly_whole(NOMINAL, seed, effects=[from_text(effect)] if effect else []))


def holed(log, share, long, seed=5):
    """The log without a share of its rows, so many at a time."""
    rows = len(log.t)
    kept = np.ones(rows, bool)
    for first in np.random.default_rng(seed).integers(50, rows - 50, round(share * rows / long)):
        kept[first:first + long] = False
    return dataclasses.replace(log, t=log.t[kept], **{name: getattr(log, name)[kept] for name in (*REQUIRED, *OPTIONAL)
                                                      if name != "t"})


def judged(log, nominal=NOMINAL):
    return report(diagnose(log, nominal))


@pytest.mark.campaign
@pytest.mark.parametrize("lost", [SINGLE, BURSTS])
def test_lost_rows_are_no_fault_of_the_vehicle_or_its_controller(lost):
    """Held commands over the gaps were two gusts, and the attitudes that the derivative had seen another controller."""
    result = judged(holed(flown(""), **lost))
    assert result["verdict"] == "consistent"
    assert any("missing" in fault["message"] for fault in result["data"]["faults"])


@pytest.mark.parametrize(("effect", "cause", "parameter", "true", "near"), [
    pytest.param("control_effectiveness:scale=0.8", "control_effectiveness", "scale", 0.8, 0.02,
                 marks=pytest.mark.campaign),
    pytest.param("actuator_delay:delay=0.03", "actuator_delay", "delay", 0.03, 0.001, marks=pytest.mark.campaign),
    pytest.param("controller_mismatch:kp_scale=1.1", "controller_mismatch", "kp_scale", 1.1, 1e-3,
                 marks=pytest.mark.campaign),
    ("controller_mismatch:delay=0.013", "controller_mismatch", "delay", 0.013, 1e-4)])
def test_a_fault_is_named_with_its_size_all_the_same(effect, cause, parameter, true, near):
    result = judged(holed(flown(effect), **SINGLE))
    assert (result["verdict"], [each["cause"] for each in result["causes"]]) == ("explained", [cause])
    assert result["causes"][0]["parameters"][parameter]["value"] == pytest.approx(true, abs=near)
