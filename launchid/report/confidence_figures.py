"""Draw the confidence range of a6 and k1, and margins and mu before and after identification (matplotlib figures)."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from sim.canvas import UNIT, save
from sim.nominal import Nominal, built_in, load_nominal
from sim.plant import dispersion, parameters

from ..experiments.confidence import (
    BAND_A6,
    BAND_A6_STD,
    BAND_K1,
    BAND_K1_STD,
    BAND_T,
    BAND_TRUE_A6,
    BAND_TRUE_K1,
    DRAWN_DELTA,
    INTERVAL,
    VERTICES,
    Band,
    BandJob,
    Bought,
    bought,
    fly_band,
)

SHOWN_SEED = 1
LABELS = {"constant": "constant", "vega_like": "VEGA-like (derived)"}


def band_figure(nominal: Nominal, bands: list[Band]) -> Figure:
    """Return panels of a6 and k1 over flight time: range |delta| <= 1, truth and tracked estimates of all `bands`."""
    figure, axes = plt.subplots(2, 1, sharex=True, figsize=(9, 6))
    figure.suptitle(f"Confidence range, {LABELS[nominal.name]}: tracked estimates with 95 % bands, flight sensors, "
                    "100 Hz", fontsize=11, y=0.95)
    t = np.linspace(0.0, max(band.table[-1, BAND_T] for band in bands), 400)
    for k, (axis, value, std, truth) in enumerate(zip(axes, (BAND_A6, BAND_K1), (BAND_A6_STD, BAND_K1_STD),
                                                      (BAND_TRUE_A6, BAND_TRUE_K1),
                                                      strict=True)):
        low, high = (parameters(nominal, t, *dispersion(nominal, d, d))[k] for d in (-1.0, 1.0))
        axis.fill_between(t, low, high, color="0.9", label="range, |delta| <= 1")
        for band in bands:
            vertex = band.delta in VERTICES
            table = band.table
            axis.plot(table[:, BAND_T], table[:, truth], "--" if vertex else ":", color="0.0" if vertex else "0.5",
                      linewidth=0.8)
            if vertex:
                half = INTERVAL * table[:, std]
                axis.fill_between(table[:, BAND_T], table[:, value] - half, table[:, value] + half, color="0.55",
                                  alpha=0.6)
            axis.plot(table[:, BAND_T], table[:, value], ".", color="0.1" if vertex else "0.6", markersize=2)
        least, most = float(min(np.min(low), np.min(high))), float(max(np.max(low), np.max(high)))
        axis.set_ylim(least - 0.15 * (most - least), most + 0.15 * (most - least))
        axis.set_ylabel(f"{('a6', 'k1')[k]} [{UNIT}]")
        axis.grid(True, color="0.85", linewidth=0.6)
    axes[0].plot([], [], "--", color="0.0", label="truth (vertices, centre)")
    axes[0].plot([], [], ".", color="0.1", label="tracked estimate")
    axes[0].legend(fontsize=8, loc="upper left")
    axes[1].set_xlabel("flight time [s]")
    return figure


def bought_figure(nominal: Nominal, what: Bought) -> Figure:
    """Return panels over flight time: worst gain margins (low, high), phase margin and mu, full and identified box."""
    figure, axes = plt.subplots(4, 1, sharex=True, figsize=(9, 8.5))
    figure.suptitle(f"What identification buys, {LABELS[nominal.name]}, delta = {DRAWN_DELTA}: worst case over the box",
                    fontsize=11, y=0.94)

    def decibel(gain: np.ndarray) -> np.ndarray:
        return 20.0 * np.log10(np.maximum(gain, 1e-3))

    rows = (("aerodynamic gain\nmargin [dB]", -decibel(what.before.gain_low), -decibel(what.after.gain_low)),
            ("high-frequency gain\nmargin [dB]", decibel(what.before.gain_high), decibel(what.after.gain_high)),
            ("phase margin\n[deg]", np.degrees(what.before.phase), np.degrees(what.after.phase)),
            ("mu [-]", what.mu_before, what.mu_after))
    for axis, (label, before, after) in zip(axes, rows, strict=True):
        axis.plot(what.t, before, "s--", color="0.55", markersize=4, label="before: full box")
        axis.plot(what.t, after, "o-", color="0.0", markersize=4, label="after: identified 95 % box")
        axis.set_ylabel(label, fontsize=9)
        axis.grid(True, color="0.85", linewidth=0.6)
    axes[0].legend(fontsize=8)
    axes[3].set_xlabel("flight time [s]")
    return figure


def confidence_figures(folder: Path, bands: dict[str, list[Band]]) -> list[str]:
    """Write two PNG figures per vehicle (name -> its dispersed flights) to `folder`; return their file names."""
    written = []
    for name, flown in bands.items():
        nominal = load_nominal(built_in(name))
        save(band_figure(nominal, flown), folder / f"confidence_{name}.png")
        shown = fly_band(BandJob(name, DRAWN_DELTA, SHOWN_SEED))
        save(bought_figure(nominal, bought(nominal, shown)), folder / f"margins_{name}.png")
        written += [f"confidence_{name}.png", f"margins_{name}.png"]
    return written
