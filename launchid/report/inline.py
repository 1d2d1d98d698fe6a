"""Put style and script of the charts into a page, which then loads nothing: reports and the live page.

uPlot (https://github.com/leeoniya/uPlot, 1.6.32 of May 2025, MIT) draws time series: 51 kB of script without
dependencies, for cursor, zoom, scales, axes and legend.  dygraphs is 2.5 times as large, Plotly 95 times.  Its
licence is in the page, too.
"""

from pathlib import Path

FOLDER = Path(__file__).parent / "assets"
MARKS = {"/* charts.css */": ("uPlot.min.css", "charts.css"), "/* charts.js */": ("uPlot.iife.min.js", "charts.js")}


def inlined(page: str) -> str:
    """Return the page (HTML) with the charts' style and script in place of the first of each key of MARKS."""
    licence = (FOLDER / "LICENCE-uPlot.txt").read_text(encoding="utf-8")
    for mark, names in MARKS.items():
        parts = [f"/* uPlot: {licence} */", *((FOLDER / name).read_text(encoding="utf-8") for name in names)]
        page = page.replace(mark, "\n".join(parts), 1)
    return page
