"""The pictures of a log and of a nominal's range."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from .canvas import UNIT, panels


def log_figure(log: Any) -> Figure:
    """A figure of a log's columns (`launchid.log.log.Log`)."""
    units = {"theta_dot": "rad/s", "theta_ddot": "rad/s^2", "rate_ref": "rad/s"}
    names = [name for name in log.columns if name != "t"]
    figure, axes = panels(len(names), f"{Path(log.path).name}: a log", 1.3)
    for axis, name in zip(axes, names, strict=True):
        axis.plot(log.t, getattr(log, name), ".", color="0.1", markersize=1.5)
        axis.set_ylabel(f"{name} [{units.get(name, 'rad')}]")
    axes[-1].set_xlabel("t [s]")
    return figure


def range_figure(nominal: Any) -> Figure:
    """A nominal's parameters (`sim.nominal.Nominal`), with their range if it has one."""
    sigma, simulation = nominal.uncertainty, nominal.simulation
    ends = [float(nominal.nodes()[-1]), simulation.duration if simulation is not None else 1.0]
    t = np.linspace(0.0, max(ends), 400)
    figure, axes = panels(2, f"{nominal.name}: parameters" + (" and their range" if sigma is not None else ""))
    for k, name in enumerate(("a6", "k1")):
        value = nominal.vehicle.at(t)[k]
        if sigma is not None:
            spread = sigma.at(t)[k]
            axes[k].fill_between(t, value * (1.0 - spread), value * (1.0 + spread), color="0.82", label="range")
        axes[k].plot(t, value, "--", color="0.3", label="nominal")
        axes[k].set_ylabel(f"{name} [{UNIT}]")
    axes[0].legend(fontsize=7, ncol=3, loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False)
    axes[1].set_xlabel("t [s]")
    return figure

