"""Draw the flights beside their joint answer, and write its report."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from ..flights.pooled import PARAMETERS
from ..formatting import with_std
from .drawing import INTERVAL
from .folder import Picture, paragraphs, write_report
from .page import table, text

if TYPE_CHECKING:
    from .flights import JointAnswer

WORDS = (("all", "the flights together, each weighted by what it tells"),
         ("p", "the probability that flights of one vehicle scatter as much; of a flight: against the others"),
         ("between flights", "what a6 and k1 differ by from flight to flight, one sigma, with its 95 % interval"),
         ("+-", "one standard deviation; figures show 95 % intervals"))


def joint_figure(found: "JointAnswer") -> Figure:
    """Draw a6 and k1 of each flight with their 95 % intervals, beside the joint answer's."""
    figure = Figure(figsize=(9, 1.6 + 0.35 * len(found.told)), layout="constrained")
    figure.suptitle(f"{len(found.flights)} flights: a6 and k1 of each, and of all", fontsize=11)
    place = np.arange(len(found.told))
    for j, name in enumerate(PARAMETERS):
        axis = figure.add_subplot(1, 2, 1 + j)
        value = np.array([each.value[j] for each in found.told])
        half = np.array([INTERVAL * math.sqrt(each.covariance[j, j]) for each in found.told])
        if found.joint is not None and not found.joint.is_of_two:
            middle, reach = found.joint.value[j], INTERVAL * found.joint.std[j]
            axis.axvspan(middle - reach, middle + reach, color="0.85", label="all, 95 % interval")
            axis.axvline(middle, color="0.3", linewidth=1.0)
        is_other = np.array([found.joint is not None and k in found.joint.others for k in range(len(found.told))], bool)
        for chosen, colour, words in ((~is_other, "#12355b", "flight"), (is_other, "#c2570c", "another vehicle")):
            if chosen.any():
                axis.errorbar(value[chosen], place[chosen], xerr=half[chosen], fmt="o", color=colour, markersize=4,
                              linewidth=1.0, label=words)
        names = [Path(each.log).name if j == 0 else "" for each in found.told]
        axis.set_yticks(place, names, fontsize=8)
        axis.invert_yaxis()
        axis.set_xlabel(f"{name} " + ("[of the nominal's]" if found.is_relative else "[1/s$^2$]"), fontsize=8)
        axis.grid(True, color="0.9", linewidth=0.6)
        axis.tick_params(labelsize=8)
    return figure


def write_joint(found: "JointAnswer", folder: str | Path) -> None:
    """Write report.html, flights.json and the figure of several flights into a folder."""
    of = {each["log"]: each["p"] for each in (found.report["one_vehicle"] or {"flights": []})["flights"]}
    rows = [[text(Path(each.log).name), *(text(with_std(each.value[j], math.sqrt(each.covariance[j, j])))
                                          for j in range(2)), f"{of[each.log]:.2g}" if each.log in of else "-"]
            for each in found.told]
    others = set() if found.joint is None else set(found.joint.others)
    first = table(
        ("flight", *PARAMETERS, "p against the others"), rows, [k in others for k in range(len(rows))])
    first += paragraphs([*found.joint_lines()[len(found.told):], f"Next: {found.report['next']}", *found.warnings])
    pictures = {"flights.png": Picture("The flights, and all of them",
                                       "Points: flights, with 95 % intervals; band: the joint answer's.",
                                       found._figure)}
    write_report(folder, found.report["headline"], f"launchid identify: {len(found.flights)} flights of one vehicle",
                 first, [("Figures", [pictures])], ("flights.json", found.to_json()), glossary=WORDS)
