"""Draw the columns of logs over each other."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from sim.canvas import panels

from .table import OPTIONAL, REQUIRED, UNITS

if TYPE_CHECKING:
    from .log import Log

LOG_STYLES: tuple[dict[str, Any], ...] = (  # that stay apart in grey
    {"color": "#12355b", "linestyle": "-"}, {"color": "#c2570c", "linestyle": "--"},
    {"color": "#2f8f6b", "linestyle": "-."}, {"color": "#000000", "linestyle": ":"})
MARKED_VALUES = 60  # values of a column that are drawn one by one, too


def columns_figure(logs: "Sequence[Log]", mark: Callable[[Any, str, int], None] | None = None) -> Figure:
    """Return a figure with a panel for each column that one of the logs has.

    mark : called with (axis, name of the column, number of the log) after the curve of each column of each log
    """
    names = [name for name in (*REQUIRED[1:], *OPTIONAL) if any(name in log.columns for log in logs)]
    title = ", ".join(Path(log.path).name for log in logs)
    figure, axes = panels(len(names), title if len(title) < 100 else f"{len(logs)} logs", 1.5)
    for axis, name in zip(axes, names, strict=True):
        for k, log in enumerate(logs):
            x = getattr(log, name)
            known = np.isfinite(log.t) & np.isfinite(x)
            if not known.any():
                continue
            axis.plot(log.t, x, linewidth=1.0, marker="." if known.sum() <= MARKED_VALUES else None, markersize=4,
                      label=Path(log.path).stem if len(logs) > 1 else "_", **LOG_STYLES[k % len(LOG_STYLES)])
            if mark is not None:
                mark(axis, name, k)
        axis.set_ylabel(f"{name} [{UNITS[name].replace('^2', '$^2$')}]", fontsize=9)
        axis.tick_params(labelsize=8)
    for axis in axes:
        if axis.get_legend_handles_labels()[1]:
            axis.legend(fontsize=7, ncol=6, loc="lower left", bbox_to_anchor=(0.0, 0.98), frameon=False)
    axes[-1].set_xlabel("t [s]")
    return figure
