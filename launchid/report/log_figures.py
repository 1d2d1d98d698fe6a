"""Draw logs before anything is computed: their columns over each other, and where the data check finds faults; as a
picture, or a page that zooms."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from sim.canvas import png_of
from sim.errors import InputError
from sim.files import write_text
from sim.sections import Nominal

from ..log.check import COLUMN_FAULTS, checked, columns_alone
from ..log.fault import Fault
from ..log.figure import columns_figure
from ..log.log import Log
from ..log.phases import phase_note
from .curves import figure_json
from .folder import COLOUR
from .page import list_of, page, picture, text


@dataclass(frozen=True, eq=False)
class Looked:
    """A log and what the data check finds in it: `faults`; `masks`, for each column the values (n,) bool that it
    doubts; `refused`, the reason why its stamps cannot be used, "" if they can; `phases`, a line on
    them, if it has several."""

    log: Log
    faults: tuple[Fault, ...]
    masks: dict[str, np.ndarray]
    refused: str = ""
    phases: tuple[str, ...] = ()

    @property
    def lines(self) -> list[str]:
        """Lines for the user, one for each fault."""
        said = [f"{self.log.path}: {fault.message}" for fault in self.faults]
        return [*said, *([self.refused] if self.refused else []), *self.phases]


def looked_at(log: Log, nominal: Nominal | None = None) -> Looked:
    """Return a log with the data check's findings, with the nominal or without; its stamps may be unusable."""
    try:
        seen = checked(log, nominal)
        found, data, refused, phases = seen.faults, seen.data, "", phase_note(log, seen.log, seen.data)
    except InputError as error:   # its clock is none
        found, data, refused, phases = (), columns_alone(log), str(error), ()
    doubted = {name: np.isfinite(getattr(log, name)) & ~mask for name, mask in data.masks.items()}
    return Looked(log, found or data.faults, doubted, refused, phases)


def logs_figure(logs: Sequence[Looked]) -> Figure:
    """Draw the columns of logs over each other, one panel each; crosses: values that the data check doubts; hatched:
    stretches of columns that it doubts as a whole."""
    return columns_figure([each.log for each in logs], lambda axis, name, k: _mark(axis, name, logs[k]))


def _mark(axis: Any, name: str, each: Looked) -> None:
    """Mark the values, or the whole stretch, of a column that the data check doubts."""
    log, x = each.log, getattr(each.log, name)
    for fault in each.faults:
        whole = fault.kind in COLUMN_FAULTS or fault.kind == "scale"
        if whole and fault.channel in (name, "t", None) and math.isfinite(fault.t_start + fault.t_end):
            axis.axvspan(fault.t_start, fault.t_end, facecolor="0.9", edgecolor="0.6", hatch="///", linewidth=0.0,
                         zorder=0)
            axis.set_title(f"hatched: {fault.kind}?", fontsize=8, loc="right")
    doubted = each.masks.get(name, np.zeros(len(x), bool)) & np.isfinite(log.t)
    if doubted.any() and not doubted[np.isfinite(x)].all():
        kinds = sorted({fault.kind for fault in each.faults
                        if fault.kind not in COLUMN_FAULTS and fault.channel in (name, "t", None)})
        axis.plot(log.t[doubted], x[doubted], "x", color="0.0", markersize=5, markeredgewidth=1.0,
                  label=f"doubted by the data check ({doubted.sum()}): {', '.join(kinds)}")


CAPTION = "Each log has its colour and dash. Crosses: values that the data check doubts; grey: columns that it doubts."


def write_page(logs: Sequence[Looked], figure: Figure, path: str) -> None:
    """Write the figure of logs, with the data check's findings, as one HTML page that needs no network."""
    said = [text(line) for each in logs for line in each.lines]
    first = "".join(f"<p>{text(each.log.summary())}</p>" for each in logs) \
        + (f"<p>{list_of(said)}</p>" if said else "<p>The data check finds nothing.</p>")
    write_text(path, [page(str(figure.get_suptitle()), "launchid show: logs as they are", COLOUR, first, [
        ("Figures", picture("columns", "Columns over time", CAPTION, png_of(figure), figure_json(figure)))])])
