"""Draw a flight and a designed test input."""

import math

import numpy as np
from matplotlib.figure import Figure

from sim.canvas import NOMINAL_COLOUR, UNIT, panels
from sim.errors import UsageError
from sim.flight import Flight
from sim.nominal import Nominal

from ..log.table import UNITS
from ..test_input import Plan
from .drawing import legend


def flight_figure(flight: Flight, nominal: Nominal) -> Figure:
    """Draw the signals of a flight, and its true a6 and k1 over the nominal's."""
    figure, axes = panels(5, f"{nominal.name}: a flight" + (", LOST at its end" if flight.lost else ""), 1.4)
    axes[2].plot(flight.t, flight.beta_cmd, color="0.7", linewidth=0.6, label="beta_cmd")
    for axis, name in zip(axes, ("theta", "theta_dot", "beta"), strict=False):
        axis.plot(flight.t, getattr(flight, name), color="0.1", linewidth=0.8, label="measured")
        axis.set_ylabel(f"{name} [{UNITS[name]}]")
    axes[0].plot(flight.t, flight.theta_ref, "--", color="0.5", linewidth=1.0, label="theta_ref")
    for axis, name in zip(axes[3:], ("a6", "k1"), strict=True):
        axis.plot(flight.t, getattr(flight, name), color="0.1", label="truth")
        axis.plot(flight.t, nominal.vehicle.at(flight.t)[name == "k1"], "--", color=NOMINAL_COLOUR, label="nominal")
        axis.set_ylabel(f"{name} [{UNIT}]")
    for axis in (axes[0], axes[2], axes[3]):
        legend(axis)
    axes[-1].set_xlabel("t [s]")
    return figure


def plan_figure(plan: Plan) -> Figure:
    """Draw a designed test input over time, and the amplitudes of its sines; UsageError if none is needed."""
    multisine = plan.nominal.test_input
    if multisine is None:
        raise UsageError("plan: no test input is needed, there is nothing to draw")
    figure = Figure(figsize=(9, 4.6))
    figure.suptitle(f"{plan.nominal.name}: test input, {plan.root_mean_square:.2e} rad rms", fontsize=11, y=0.96)
    above, below = figure.subplots(2, 1)
    longest = min(multisine.duration, 2 * 2.0 * math.pi / min(multisine.frequency))
    t = multisine.start + np.linspace(0.0, longest, 2000, endpoint=False)
    above.plot(t, multisine.at(t), color="0.1", linewidth=0.9)
    above.set_xlabel("t [s]")
    above.set_ylabel("angle [rad]")
    below.vlines(multisine.frequency, 0.0, multisine.amplitude, color="0.1")
    below.plot(multisine.frequency, multisine.amplitude, "o", color="0.1", markersize=4)
    below.set_xlabel("frequency [rad/s]")
    below.set_ylabel("amplitude [rad]")
    below.set_ylim(bottom=0.0)
    for axis in (above, below):
        axis.grid(True, color="0.85", linewidth=0.6)
    figure.subplots_adjust(hspace=0.45)
    return figure
