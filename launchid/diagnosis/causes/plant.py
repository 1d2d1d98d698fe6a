"""Causes in the vehicle itself, and terms of its equation that the catalogue does not hold."""

import math
from dataclasses import replace

import numpy as np

from ..data.record import Record
from .hypothesis import Free, Hypothesis, Start, Steps, Values, as_deflected, as_dispersed, input_moves, size

SLOSH_FREQUENCIES = tuple(np.geomspace(1.0, 20.0, 28))      # rad/s: liquid propellant, 0.15 to 3 Hz
BENDING_PER_NYQUIST = 0.9   # highest bending frequency tried over the log's Nyquist frequency
BENDING_RESOLVED = 0.45     # rad a step, of the same
LOWEST_BENDING = 6.0        # rad/s
BENDING_PER_E = 6.0         # frequencies tried in a factor e
START_DAMPING = 0.05        # broad enough for a coarse grid of frequencies
DAMPING = Free("damping_ratio", 0.1, 0.002, 0.2, logarithmic=True)  # beyond it a mode is a filter for anything
FASTEST_DRIFT = 1.0         # 1/s: lift and thrust turn a launcher's path with some 0.05 1/s
DRIFT_STEP = 1e-5           # 1/s: of a vehicle in trim the nozzle's part is like the angle's, and slopes so alike must
                            # not differ by what is not proportional (gamma turns the angle: 1e-3 1/s times half a log)
ANOTHER_PART = "a longer log"
FLIGHT_PATH = "the flight-path angle of the navigation (column gamma)"
ANOTHER_PROFILE = "a flight in which a6 and k1 change differently"


def _slosh(record: Record) -> list[Values]:
    return [(float(w), START_DAMPING) for w in SLOSH_FREQUENCIES]


def _bending(record: Record) -> list[Values]:
    top = min(BENDING_PER_NYQUIST * math.pi / record.period, BENDING_RESOLVED / record.resolution)
    count = max(4, round(BENDING_PER_E * math.log(top / LOWEST_BENDING)))
    return [(float(w), START_DAMPING) for w in np.geomspace(LOWEST_BENDING, top, count)]


def _middle(record: Record) -> Values:
    return (float(0.5 * (record.t[0] + record.t[-1])),)


CAUSES = (
    Hypothesis("control_effectiveness", (size("scale", 0.01, 0.05, 5.0),), 1.0,
               "the nozzle turns the vehicle with {scale} of the k1 the simulation believes",
               visible=input_moves, floor=as_dispersed, twin="actuator_gain"),
    Hypothesis("control_loss", (size("fraction", 0.01, -0.95, 0.95), Free("time", 0.05)), 0.0,
               "k1 drops by {fraction} at {time}", visible=input_moves, start=Start.ONSET, limit_at=_middle,
               largest=1.0, may_repeat=True, tells_onset=True, steps=Steps(3.0, (0.25, 0.8))),
    Hypothesis("aero_instability", (size("scale", 0.01, -5.0, 10.0),), 1.0,
               "a6 is {scale} of what the simulation believes", floor=as_dispersed),
    Hypothesis("aero_damping", (size("coefficient", 0.01),), 0.0,
               "the rotation is damped by {coefficient}, which the simulation lacks"),
    Hypothesis("aero_cubic", (size("coefficient", 0.5),), 0.0,
               "the aerodynamic moment is not proportional to the angle: cubic coefficient {coefficient}"),
    Hypothesis("friction", (size("coefficient", 1e-3, 0.0),), 0.0,
               "dry friction of {coefficient} opposes the rotation"),
    Hypothesis("thrust_misalignment", (size("angle", 1e-4),), 0.0, "the thrust is {angle} off the nozzle's axis",
               decides=(("attitude_bias", ANOTHER_PROFILE),), held=as_deflected),
    Hypothesis("slosh", (size("coupling", 0.005, -0.8, 5.0),
                         Free("frequency", 2e-3, 0.2, 25.0, logarithmic=True),  # faster, it is no liquid
                         DAMPING), 0.0,
               "propellant sloshes at {frequency} (coupling {coupling}, damping ratio {damping_ratio})",
               _slosh, limit_at=lambda record: (4.0, 0.02), is_mode=True, may_repeat=True),
    Hypothesis("bending", (size("gain", 1e-4), Free("frequency", 2e-3, 0.2, 300.0, logarithmic=True), DAMPING), 0.0,
               "the structure bends at {frequency} (gain {gain}, damping ratio {damping_ratio})",
               _bending, limit_at=lambda record: (25.0, 0.03), is_mode=True, may_repeat=True),
    Hypothesis("moment_step", (size("acceleration", 1e-4), Free("time", 0.05)), 0.0,
               "a moment of {acceleration} sets in at {time} and stays", start=Start.STEP, limit_at=_middle,
               may_repeat=True, tells_onset=True),
    Hypothesis("nozzle_inertia", (size("coefficient", 1e-4),), 0.0,
               "the moving nozzle kicks back: {coefficient} times its acceleration turns the vehicle",
               visible=input_moves),
    Hypothesis("control_slope", (size("slope", 1e-4, -0.2, 0.2),), 0.0,
               "k1 runs away from the simulated one by {slope}, about the log's centre", visible=input_moves,
               decides=(("control_effectiveness", ANOTHER_PART),)),
    Hypothesis("lateral_drift", (size("z_alpha", DRIFT_STEP, -FASTEST_DRIFT, FASTEST_DRIFT),
                                 size("z_beta", DRIFT_STEP, -FASTEST_DRIFT, FASTEST_DRIFT)), 0.0,
               "the flight path drifts, by {z_alpha} of the angle of attack and {z_beta} of the nozzle's",
               lambda record: [(0.0,)], limit_at=lambda record: (0.0,),
               decides=(("aero_instability", FLIGHT_PATH),),
               visible=lambda record: not record.path_is_known),  # what is measured is no matter of belief
)

MISSING_TERM = Hypothesis("missing_term", (size("coefficient", 1e-3),), 0.0,
                          "the angular acceleration lacks {coefficient} times {term}")


def missing_term(term: str) -> Hypothesis:
    """A library term with a free coefficient."""
    return replace(MISSING_TERM, fixed=(("term", term),))
