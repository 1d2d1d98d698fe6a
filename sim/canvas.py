"""Make and save the figures: panels over one abscissa, files written whole and with the same bytes each time."""

import io
import sys
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.figure import Figure

from .errors import UsageError
from .files import as_path, atomic_path

DPI = 110
UNIT = "1/s$^2$"
TRACKED, TRACKED_BAND = "#1f5fa8", "#c3d6ec"  # in print they differ from the nominal by line and weight
NOMINAL_COLOUR = "#b8560b"  # dashed, everywhere
METADATA: dict[str, dict[str, Any]] = {  # what would differ from day to day is left out
    ".png": {"Software": None}, ".svg": {"Date": None}, ".pdf": {"CreationDate": None}}


def check_suffix(path: str | Path) -> str:
    """Return the path's suffix as the format to write (.png without one); UsageError unless .png, .svg or .pdf."""
    suffix = as_path(path).suffix.lower() or ".png"
    if suffix not in METADATA:
        raise UsageError(f"{path}: a plot is written as .png, .svg or .pdf")
    return suffix


def save(figure: Figure, path: str | Path) -> None:
    """Write the figure as PNG, or as the suffix says; whole or not at all, the same bytes each time.  Closes it."""
    suffix = check_suffix(path)
    with atomic_path(path) as temporary, matplotlib.rc_context({"svg.hashsalt": "launchid"}):
        figure.savefig(temporary, dpi=DPI, bbox_inches="tight", format=suffix[1:], metadata=METADATA[suffix])
    pyplot = sys.modules.get("matplotlib.pyplot")
    if pyplot is not None:  # which keeps the figures that it made
        pyplot.close(figure)


def png_of(figure: Figure, dpi: int = DPI) -> bytes:
    """Return the figure as PNG, the same bytes each time."""
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=dpi, bbox_inches="tight", format="png", metadata=METADATA[".png"])
    return buffer.getvalue()


def panels(rows: int, title: str, height: float = 2.0) -> tuple[Figure, list[Any]]:
    """Return a figure and its `rows` axes, each `height` [inch], over one abscissa; no window shows it by itself."""
    figure = Figure(figsize=(9, 0.8 + height * rows), layout="constrained")
    axes = list(figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0])
    figure.suptitle(title, fontsize=11)
    for axis in axes:
        axis.grid(True, color="0.85", linewidth=0.6)
    return figure, axes
