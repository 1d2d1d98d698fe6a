"""Draw the paper's figures: axes with units, the truth drawn, readable in grey."""

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from launchid_core import polynomial
from sim.canvas import UNIT, panels, save
from sim.flight import fly_whole
from sim.plant import dispersion, parameters

from ..experiments.cases import CASES
from ..experiments.flights import START, TRUE_A6, TRUE_K1, WINDOW_A6, WINDOW_END, WINDOW_K1, Result, case_nominal

GREYS = {-1: ("0.0", ":"), 0: ("0.0", "-"), 1: ("0.0", "--")}
SMALLEST_ERROR = 1e-17  # an error of 0 on a logarithmic axis: below what a float can be off
BELOW = 1e-4            # of the tolerance: where the errors' axis ends, smaller ones are counted


def loop_figure() -> Figure:
    """Draw figure 1 of the paper: the control loop as a block diagram."""
    figure = Figure(figsize=(10, 3.6))
    axis = figure.subplots()
    axis.set_axis_off()
    axis.set_xlim(0, 10)
    axis.set_ylim(0, 3.6)
    blocks = {"guidance\n(look-up table)": (0.1, 2.1), "PD control\npseudo-derivative": (2.2, 2.1),
              "TVC actuator\n2nd order": (4.5, 2.1), "launcher\n$\\ddot\\theta=a_6\\theta+k_1\\beta$": (6.8, 2.1),
              "navigation\n+ white noise": (4.5, 0.3), "launchid_core\nupdate(sample)": (8.3, 0.3)}
    for text, (x, y) in blocks.items():
        axis.add_patch(FancyBboxPatch((x, y), 1.6, 0.9, boxstyle="round,pad=0.03", facecolor="0.94", edgecolor="0.2"))
        axis.text(x + 0.8, y + 0.45, text, ha="center", va="center", fontsize=9)

    def arrow(points: list[tuple[float, float]], label: str, at: tuple[float, float]) -> None:
        for start, end in itertools.pairwise(points):
            style = "->" if end == points[-1] else "-"
            axis.annotate("", end, start, arrowprops={"arrowstyle": style, "color": "0.1", "shrinkA": 0, "shrinkB": 0})
        axis.text(*at, label, fontsize=9)

    arrow([(1.75, 2.55), (2.15, 2.55)], "$\\theta_{ref}$", (1.76, 2.68))
    arrow([(3.85, 2.55), (4.45, 2.55)], "$\\beta_{cmd}$", (3.95, 2.68))
    arrow([(6.15, 2.55), (6.75, 2.55)], "$\\beta$", (6.4, 2.68))
    arrow([(8.45, 2.55), (9.3, 2.55), (9.3, 1.25)], "$\\theta,\\dot\\theta,\\beta$", (8.55, 2.68))
    arrow([(7.6, 2.05), (7.6, 0.75), (6.15, 0.75)], "$\\theta$", (7.65, 1.6))
    arrow([(4.45, 0.75), (3.0, 0.75), (3.0, 2.05)], "$\\theta$ measured", (3.1, 0.85))
    axis.text(4.5, 3.25, "+ command noise, deflection limit", fontsize=8, color="0.3")
    figure.suptitle("Fig. 1  The loop: simulator (sim) and estimator (launchid_core)", fontsize=11)
    return figure


def steps_figure(results: list[Result]) -> Figure:
    """Draw figure 2 of the paper: the steps of the identification, and the coefficients Xi as a 10 x 3 matrix."""
    nominal = case_nominal(CASES["constant"])
    result = min(results, key=lambda r: r.seed)
    flight = fly_whole(nominal, result.seed, "ideal")
    rng = np.random.default_rng(result.seed)
    figure = Figure(figsize=(11, 4.6))
    grid = figure.add_gridspec(3, 3, width_ratios=[1.2, 0.8, 1.2], wspace=0.45)
    shown = slice(10_000, 10_400)
    pick = np.sort(rng.choice(400, 133, replace=False))
    for k, (name, unit) in enumerate((("theta", "rad"), ("theta_dot", "rad/s"), ("beta", "rad"))):
        axis = figure.add_subplot(grid[k, 0])
        t, x = flight.t[shown], getattr(flight, name)[shown]
        axis.plot(t, x, color="0.7", linewidth=3, label="all samples")
        axis.plot(t[pick], x[pick], ".", color="0.1", markersize=2.5, label="one third kept")
        axis.set_ylabel(f"{name}\n[{unit}]", fontsize=8)
        axis.tick_params(labelsize=7)
    axis.set_xlabel("t [s]", fontsize=8)
    axis.legend(fontsize=7, loc="best")
    text = figure.add_subplot(grid[:, 1])
    text.set_axis_off()
    text.text(0.5, 0.5, "1  collect X, $\\dot X$\n\n2  compress: random rows\n$Y = C X$\n\n3  library $\\Theta(Y)$\n"
              + "ten terms, order 2\n\n4  sparse regression\n$\\dot Y = \\Theta(Y)\\,\\Xi$\nthreshold 0.5", ha="center",
              va="center", fontsize=10)
    axis = figure.add_subplot(grid[:, 2])
    xi = result.xi
    shown_values = np.where(xi == 0, np.nan, np.sign(xi) * np.log10(1 + np.abs(xi)))
    axis.imshow(np.ma.masked_invalid(shown_values), cmap="Greys", vmin=-6, vmax=8, aspect="auto")
    for i in range(xi.shape[0]):
        for j in range(3):
            axis.text(j, i, f"{xi[i, j]:.4g}" if xi[i, j] else "0", ha="center", va="center", fontsize=8,
                      color="0.6" if xi[i, j] == 0 else "0.0", fontweight="bold" if j == 1 and xi[i, j] else "normal")
    axis.set_xticks(range(3), ["$\\dot\\theta$", "$\\ddot\\theta$", "$\\dot\\beta$\n(informative)"])
    axis.set_yticks(range(10), list(polynomial(2)), fontsize=8)
    axis.set_title("$\\Xi$ (10 x 3)", fontsize=10)
    figure.suptitle("Fig. 2  Compressed sparse regression, constant dynamics: truth a6 = 2, k1 = -7 1/s$^2$, "
                    "70 s at 1 kHz", fontsize=11)
    return figure


def _error_scale(axis: Any, tolerance: float) -> None:
    """Set a logarithmic ordinate around the tolerance; points below it are marked at its edge and counted."""
    t, error = (np.concatenate([line.get_data()[k] for line in axis.lines if line.get_marker() == "."]) for k in (0, 1))
    least, most = tolerance * BELOW, max(10.0 * tolerance, 1.5 * float(np.nanmax(error)))
    axis.set_yscale("log")
    axis.set_ylim(least, most)
    under = error < least
    if under.any():
        axis.plot(t[under], np.full(np.count_nonzero(under), least), "v", color="0.25", markersize=2.5, clip_on=False)
        axis.text(0.005, 0.06, f"{np.count_nonzero(under)} of {len(error)} windows below {least:.0e}, the median of "
                  f"them {np.median(error[under]):.0e}", transform=axis.transAxes, fontsize=7,
                  bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0, "alpha": 0.8})


def windows_figure(name: str, results: list[Result], title: str) -> Figure:
    """Draw a6 and k1 of a case's windows with all seeds over the truth, and errors with the tolerance band (the paper's
    figures 3, 4, 6, 8)."""
    case = CASES[name]
    figure, axes = panels(4, title, 1.7)
    nominal = case_nominal(case)
    end = max(result.tables[0][-1, WINDOW_END] for result in results)
    fine = np.linspace(0.0, end, 800)
    for delta in case.deltas:
        a6, k1 = parameters(nominal, fine, *dispersion(nominal, delta, delta))
        grey, line = GREYS[delta]
        axes[0].plot(fine, a6, color=grey, linestyle=line, linewidth=1.2, label=f"truth, delta = {delta:+d}")
        axes[1].plot(fine, k1, color=grey, linestyle=line, linewidth=1.2)
    table = np.concatenate([result.tables[0] for result in results])
    t = 0.5 * (table[:, START] + table[:, WINDOW_END])
    floor = case.absolute / case.relative if case.absolute else 0.0
    for axis, value, truth, error in ((axes[0], WINDOW_A6, TRUE_A6, axes[2]), (axes[1], WINDOW_K1, TRUE_K1, axes[3])):
        axis.plot(t, table[:, value], ".", color="0.75", markersize=5.0, zorder=1)
        relative = (table[:, value] - table[:, truth]) / np.maximum(np.abs(table[:, truth]), floor)
        error.plot(t, np.maximum(np.abs(relative), SMALLEST_ERROR), ".", color="0.25", markersize=2.0)
    for axis, label in ((axes[2], "a6"), (axes[3], "k1")):
        axis.axhline(case.relative, color="0.0", linestyle="--", linewidth=1.0)
        axis.text(end, case.relative * 1.3, f"{100 * case.relative:g} %", ha="right", fontsize=8)
        _error_scale(axis, case.relative)
        axis.set_ylabel(f"|error| of {label}\n(relative)", fontsize=8)
    for axis, label in ((axes[0], "a6"), (axes[1], "k1")):
        low, high = axis.get_ylim()
        if high - low < 1e-3:  # a constant truth, met to rounding: show it with room around it
            middle = 0.5 * (low + high)
            axis.set_ylim(middle - 0.1 * abs(middle), middle + 0.1 * abs(middle))
        axis.ticklabel_format(useOffset=False)
        axis.set_ylabel(f"{label} [{UNIT}]")
    axes[0].legend(fontsize=8, ncol=4, loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False)
    axes[3].set_xlabel("flight time [s]   (dots: every window of every seed, 1 kHz, ideal suite)")
    return figure


def profile_figure(title: str, with_range: bool) -> Figure:
    """Draw figure 5 of the paper, the profile of a6 and k1, or figure 7, with its uncertainty ranges."""
    figure, axes = panels(2, title)
    styles = {"vega-dispersed": ("0.75", "sigma = 0.25"), "vega-dispersed-profile": ("0.45", "sigma(t), proposed")}
    nominal = case_nominal(CASES["vega"])
    for k, axis in enumerate(axes):
        axis.plot(nominal.vehicle.t, (nominal.vehicle.a6, nominal.vehicle.k1)[k], "o-", color="0.0", markersize=3,
                  linewidth=1.2, label="nominal (VEGA-like, derived)")
        for name, (grey, label) in styles.items() if with_range else ():
            dispersed = case_nominal(CASES[name])
            t = np.linspace(0.0, nominal.vehicle.t[-1], 400)
            low = parameters(dispersed, t, *dispersion(dispersed, -1, -1))[k]
            high = parameters(dispersed, t, *dispersion(dispersed, 1, 1))[k]
            axis.fill_between(t, low, high, facecolor=grey, alpha=0.5, label=label, edgecolor="0.2", linewidth=0.5)
        axis.set_ylabel(f"{('a6', 'k1')[k]} [{UNIT}]")
    axes[0].legend(fontsize=8, ncol=4, loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False)
    axes[1].set_xlabel("flight time [s]")
    return figure


def tuning_figure(results: list[Result]) -> Figure:
    """Draw how good a6 is over the threshold, and over window and compression, on clean data and flight sensors."""
    case = CASES["tuning"]
    figure = Figure(figsize=(12, 3.8))
    axes = figure.subplots(1, 3)
    figure.suptitle("Tuning on the constant nominal (1 kHz ideal, 100 Hz flight sensors)", fontsize=11)
    groups: dict[str, dict[float, tuple[float, float]]] = {}
    for k, variant in enumerate(case.variants):
        table = np.concatenate([result.tables[k] for result in results])
        error = float(np.nanmedian(np.abs(table[:, WINDOW_A6] / table[:, TRUE_A6] - 1)))
        inside = float(np.mean(np.abs(table[:, WINDOW_A6] / table[:, TRUE_A6] - 1) < case.relative))
        if variant.threshold is not None:
            groups.setdefault("threshold", {})[variant.threshold] = (error, inside)
        else:
            groups.setdefault(f"{variant.suite} {variant.compression}", {})[variant.window] = (error, inside)
    threshold = groups.pop("threshold")
    axes[0].semilogx(list(threshold), [100 * v[1] for v in threshold.values()], "o-", color="0.1")
    axes[0].set_xlabel("threshold [raw units]")
    axes[0].set_ylabel("windows with a6 within 1 % [%]")
    axes[0].set_title("ten terms, differenced, 1 s", fontsize=9)
    for name, values in groups.items():
        suite, compression = name.split()
        axis = axes[1] if suite == "ideal" else axes[2]
        style = {"1": ("o-", "0.0"), "3": ("s--", "0.4"), "10": ("^:", "0.6")}[compression]
        index = 1 if suite == "ideal" else 0
        axis.plot(list(values), [100 * v[index] for v in values.values()], style[0], color=style[1],
                  label=f"compression {compression}")
        axis.set_xscale("log")
        axis.set_xticks(list(values), [f"{window:g}" for window in values])
        axis.set_xticks([], minor=True)
        axis.set_xlabel("window [s]")
        axis.legend(fontsize=8)
    axes[1].set_ylabel("windows with a6 within 1 % [%]")
    axes[1].set_title("ten terms, differenced, clean", fontsize=9)
    axes[2].set_ylabel("median |error| of a6 [%]")
    axes[2].set_yscale("log")
    axes[2].set_title("integral, flight sensors", fontsize=9)
    for axis in axes:
        axis.grid(True, color="0.85", linewidth=0.6)
    figure.tight_layout()
    return figure


FIGURES: dict[str, dict[str, Callable[[list[Result]], Figure]]] = {  # case -> file -> figure
    "constant": {"figure1_loop.png": lambda results: loop_figure(), "figure2_steps.png": steps_figure},
    "windowed": {"figure3_windowed.png": lambda results: windows_figure(
        "windowed", results, "Fig. 3  Constant dynamics, 1 s windows, ten terms, compression 3")},
    "dispersed": {"figure4_dispersed.png": lambda results: windows_figure(
        "dispersed", results, "Fig. 4  Constant dynamics, dispersed (sigma = 0.25), 1 s windows")},
    "vega": {"figure5_profile.png": lambda results: profile_figure("Fig. 5  VEGA-like profile (derived)", False),
             "figure6_vega.png": lambda results: windows_figure(
                 "vega", results, "Fig. 6  VEGA-like (derived), 0.3 s windows, theta, beta, tau*theta, tau*beta")},
    "vega-dispersed": {
        "figure7_range.png": lambda results: profile_figure("Fig. 7  VEGA-like profile (derived) with its uncertainty",
                                                            True),
        "figure8_vega_dispersed.png": lambda results: windows_figure(
            "vega-dispersed", results, "Fig. 8  VEGA-like (derived), dispersed, sigma = 0.25")},
    "vega-dispersed-profile": {"figure8b_vega_dispersed_profile.png": lambda results: windows_figure(
        "vega-dispersed-profile", results,
        "Fig. 8b  VEGA-like (derived), dispersed, sigma over flight time (proposed)")},
    "greensite": {"greensite.png": lambda results: windows_figure(
        "greensite", results, "NASA CR-826 launcher, 0.3 s windows (kink at 72 s)")},
    "tuning": {"tuning.png": tuning_figure}}


def paper_figures(folder: Path, case: str, results: list[Result]) -> list[str]:
    """Draw the figures of an experiment that ran, write them into the folder, and return their file names."""
    for name, make in FIGURES[case].items():
        save(make(results), folder / name)
    return list(FIGURES[case])
