"""The parts that the figures of a diagnosis share: axes, styles that stay apart in grey, words."""

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from ..judge.diagnosis import Diagnosis

UNITS = {"theta": "rad", "theta_dot": "rad/s", "beta": "rad"}
SYMBOLS = {"theta": "attitude theta", "theta_dot": "rate theta_dot", "beta": "nozzle beta"}
EXTENDED = {"explained": "with the causes", "dominant": "with the causes", "consistent": "with the causes",
            "unexplained": "with the nearest known causes"}
PATCH = {"facecolor": "white", "edgecolor": "none", "pad": 0.5, "alpha": 0.8}
MEASURED: dict[str, Any] = {"color": "0.72", "linewidth": 2.6, "linestyle": "-"}
BEFORE: dict[str, Any] = {"color": "#c2570c", "linewidth": 1.0, "linestyle": "--"}
AFTER: dict[str, Any] = {"color": "#12355b", "linewidth": 1.0, "linestyle": "-"}


def axes_of(rows: int, columns: int, size: tuple[float, float], **options: Any) -> tuple[Figure, np.ndarray]:
    figure, axes = plt.subplots(rows, columns, figsize=size, squeeze=False, layout="constrained", **options)
    for axis in axes.flat:
        axis.grid(True, color="0.88", linewidth=0.6)
        axis.tick_params(labelsize=8)
    return figure, axes


def legend_above(figure: Figure, axis: Any) -> None:
    figure.legend(*axis.get_legend_handles_labels(), loc="outside upper right", ncol=3, fontsize=8, frameon=False)


def mark_times(axis: Any, made: Diagnosis, named: bool = True) -> None:
    """Mark when causes begin and end, for those that do; `named` in the uppermost of panels, where that hides least."""
    for cause in (*made.causes, *made.nearest):
        start, duration = (cause.values.get(name) for name in ("time", "duration"))
        times = [] if start is None else [start] if duration is None else [start, float(start) + float(duration)]
        for time, word in zip(times, (cause.cause, "ends"), strict=False):
            axis.axvline(float(time), color="0.0", linestyle="-.", linewidth=0.9)
            if not named:
                continue
            axis.annotate(word, (float(time), 1.0), xycoords=("data", "axes fraction"), xytext=(3, -9),
                          textcoords="offset points", fontsize=7, bbox=PATCH)
