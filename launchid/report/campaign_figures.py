"""Draw a campaign: the bounds on each requirement over its flights, and the tail of each metric."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ..monte_carlo.requirement.flight import METRICS
from ..monte_carlo.requirement.folder import Flights
from ..monte_carlo.requirement.grammar import Requirement
from ..monte_carlo.requirement.sequential import Planned, Sequential

HEADROOM = 0.8  # inches above the panels
TITLE = 0.2     # inches of it above the title
PANEL = 2.4     # inches, height of a panel
LOOKS = 60      # at a sequential test, evenly in log n
LEGEND = {"fontsize": 7, "loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "frameon": False, "ncol": 4}


def campaign_figure(report: dict[str, Any], requirements: Sequence[Requirement], flights: Flights) -> Figure:
    """Return a figure: a panel per requirement (its bounds over the flights), a panel per metric (its tail)."""
    metrics = [asked.metric for asked in requirements if asked.limit is not None] if requirements else list(METRICS)
    metrics = list(dict.fromkeys(metrics))
    rows = len(requirements) + len(metrics)
    height = HEADROOM + PANEL * rows
    figure = Figure(figsize=(9, height))
    verdict = f": {report['verdict']}" if report["verdict"] else ""
    figure.suptitle(f"{report['nominal']}, {report['flown']} flights, {report['lost']} lost{verdict}", fontsize=11,
                    y=1.0 - TITLE / height)
    axes = list(figure.subplots(rows, 1, squeeze=False)[:, 0])
    for axis, asked in zip(axes, requirements, strict=False):
        _bounds_panel(axis, asked, flights, report["stop"] == "never")
    for axis, metric in zip(axes[len(requirements):], metrics, strict=True):
        _tail_panel(axis, metric, report, flights)
    for axis in axes:
        axis.grid(True, color="0.85", linewidth=0.6)
    figure.subplots_adjust(top=1.0 - HEADROOM / height, bottom=0.5 / height, hspace=0.65)
    return figure


def _bounds_panel(axis: Any, asked: Requirement, flights: Flights, planned: bool) -> None:
    """Draw the share of flights that failed, its bounds, and the required probability, over the flights."""
    failed = np.cumsum([1 if isinstance(row, str) else int(asked.fails(row)) for row in flights.outcomes])
    n = len(failed)
    looks = np.array([n]) if planned else np.unique(np.geomspace(1, n, LOOKS).astype(int))
    rule = (Planned if planned else Sequential)(asked.probability, asked.confidence)
    bounds = np.array([rule.bounds(int(look), int(failed[look - 1])) for look in looks])
    over = np.arange(1, n + 1)
    if failed[-1] > 0:
        axis.plot(over, np.where(failed > 0, failed / over, np.nan), color="0.5", linewidth=0.9,
                  label="share that failed")
    style = "_" if planned else "-"
    axis.plot(looks, bounds[:, 1], style, color="0.0", linewidth=1.3, markersize=12,
              label=f"upper bound, confidence {asked.confidence:g}")
    if np.any(bounds[:, 0] > 0.0):
        axis.plot(looks, np.where(bounds[:, 0] > 0.0, bounds[:, 0], np.nan), style, color="0.0", linewidth=0.7,
                  markersize=8, label="lower bound")
    axis.axhline(asked.probability, color="0.0", linestyle="--", linewidth=1.0, label=f"asked: {asked.text}")
    axis.set_yscale("log")
    axis.set_ylim(min(0.3 * asked.probability, 0.5 * float(bounds[-1, 1])), 1.3)
    axis.set_xlim(0, n)
    axis.set_xlabel("flights")
    axis.set_ylabel("probability\nof failure")
    axis.legend(**LEGEND)


def _tail_panel(axis: Any, metric: str, report: dict[str, Any], flights: Flights) -> None:
    """Draw the share of flights above each value, with limits and order statistics; lost flights are in the share."""
    values = np.sort([float(row[metric]) for row in flights.outcomes if isinstance(row, dict) and not row["lost"]])
    beyond = len(flights.outcomes) - len(values)
    share = (beyond + np.arange(len(values), 0, -1)) / len(flights.outcomes)
    axis.step(values, share, where="pre", color="0.1", linewidth=1.2, label="flights at or above")
    for result in report["results"]:
        if result["metric"] == metric:
            axis.plot([result["limit"]], [result["probability"]], "v", color="0.0", markersize=6,
                      label=f"asked: {result['requirement']}")
            known = result["quantile"]["value"]
            if known is not None:
                axis.axvline(known, color="0.4", linestyle=":", linewidth=1.1,
                             label=f"{100.0 * result['quantile']['share']:.6g} % are below, confidence "
                                   f"{result['confidence']:g}")
    axis.set_yscale("log")
    axis.set_xlabel(f"{metric} [{METRICS[metric]}]")
    axis.set_ylabel("share of\nflights")
    axis.legend(**LEGEND)
