"""Draw a nominal's a6 and k1 over flight time with their range."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from .canvas import NOMINAL_COLOUR, UNIT, panels


def range_figure(nominal: Any) -> Figure:
    """Return a figure of a nominal's (`sim.nominal.Nominal`) a6 and k1 over flight time, with their range if any."""
    sigma, simulation = nominal.uncertainty, nominal.simulation
    ends = [float(nominal.nodes()[-1]), simulation.duration if simulation is not None else 1.0]
    t = np.linspace(0.0, max(ends), 400)
    figure, axes = panels(2, f"{nominal.name}: parameters" + (" and their range" if sigma is not None else ""))
    for k, name in enumerate(("a6", "k1")):
        value = nominal.vehicle.at(t)[k]
        if sigma is not None:
            spread = sigma.at(t)[k]
            axes[k].fill_between(t, value * (1.0 - spread), value * (1.0 + spread), color="0.82", label="range")
        axes[k].plot(t, value, "--", color=NOMINAL_COLOUR, label="nominal")
        axes[k].set_ylabel(f"{name} [{UNIT}]")
    axes[0].legend(fontsize=7, ncol=3, loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False)
    axes[1].set_xlabel("t [s]")
    return figure

