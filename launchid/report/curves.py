"""Turn a matplotlib figure of curves into JSON that `charts.js` draws again, so that a picture is described once.

    {"columns", "arrays": [[...]], "panels": [{"row", "rows", "column", "columns", "height" [px], "group", "title", "x",
     "abscissa", "log", "xlim", "ylim", "series": [{"x", "y" (indices of arrays), "label", "color", "width", "dash",
     "size"}], "bands": [{"x", "low", "high" (indices of arrays), "label", "color"}], "marks": [{"axis", "from", "to",
     "color", ...} | {"at", "words"}]}]}

Panels of one group share their abscissa.
"""

import re
from typing import Any

import numpy as np
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.text import Annotation

PIXELS = 88          # an inch: the width of a report over that of its figures
AROUND = 64          # px of a panel for title, axis and legend
MOST_POINTS = 20_000  # points of a curve: of more the lowest and highest of each group are kept
X_DIGITS = 12        # stamps may be since 1970
Y_DIGITS = 5         # a picture shows no sixth digit
DASHES: dict[str, list[int]] = {"-": [], "--": [6, 4], ":": [2, 3], "-.": [8, 3, 2, 3]}

Json = dict[str, Any]


class Arrays:
    """Distinct arrays of numbers as lists for JSON (`lists`); NaN is null."""

    def __init__(self) -> None:
        self.lists: list[list[float | None]] = []
        self._places: dict[bytes, int] = {}

    def place(self, x: np.ndarray, digits: int) -> int:
        """Return the index of x (n,) in `lists`, where it is added, rounded to `digits` digits, unless it is there."""
        key = x.tobytes()
        if key not in self._places:
            self._places[key] = len(self.lists)
            self.lists.append([float(f"{v:.{digits}g}") if np.isfinite(v) else None for v in x.tolist()])
        return self._places[key]


def figure_json(figure: Figure) -> Json | None:
    """Return the figure as JSON; None if it holds more than lines, bands and words (bars, error bars, an image)."""
    axes = figure.axes
    if not axes or any(axis.containers or axis.images or
                       any(not hasattr(each, "band") for each in axis.collections) for axis in axes):
        return None
    arrays, styles = Arrays(), {_style(line): str(line.get_label()) for axis in axes for line in axis.lines
                                if not str(line.get_label()).startswith("_")}
    panels = [_panel(axis, axes, arrays, styles) for axis in axes if axis.lines or axis.collections]
    return {"columns": max(each["column"] + each["columns"] for each in panels), "arrays": arrays.lists,
            "panels": panels}


def _panel(axis: Any, axes: list[Any], arrays: Arrays, styles: dict[Any, str]) -> Json:
    place, figure = axis.get_subplotspec(), axis.get_figure()
    title, y = _words(axis.get_title(loc="left") or axis.get_title()), _words(axis.get_ylabel())
    shared = axis.get_shared_x_axes().get_siblings(axis)
    names = styles if any(_style(line) in styles for line in axis.lines) else {}
    series: list[Json] = []
    for line in axis.lines:
        t, x = (np.asarray(part, dtype=float) for part in line.get_data())
        if line.get_transform() == axis.transData and len(t):
            kept = _thinned(t, x)
            name = str(line.get_label()) if not str(line.get_label()).startswith("_") else \
                names.get(_style(line), "").partition(":")[0] if names else "" if series else \
                y.partition(" [")[0] or title.partition(":")[0]
            series.append({"x": arrays.place(t[kept], X_DIGITS), "y": arrays.place(x[kept], Y_DIGITS),
                           "label": _words(name), "color": to_hex(line.get_color()),
                           "width": line.get_linewidth() if line.get_linestyle() in DASHES else 0,
                           "dash": DASHES.get(line.get_linestyle(), []),
                           "size": 0 if line.get_marker() in ("None", "", None) else 1.3 * line.get_markersize()})
    return {"row": place.rowspan.start, "rows": len(place.rowspan), "column": place.colspan.start,
            "columns": len(place.colspan), "group": min(axes.index(each) for each in shared),
            "height": round(PIXELS * figure.get_figheight() * axis.get_position().height) + AROUND,
            "title": ": ".join(filter(None, (y, title))), "x": _words(axis.get_xlabel()),
            "abscissa": max((_words(each.get_xlabel()) for each in shared), key=len),
            "log": [axis.get_xscale() == "log", axis.get_yscale() == "log"], "xlim": list(map(float, axis.get_xlim())),
            "ylim": list(map(float, axis.get_ylim())), "series": series, "bands": _bands(axis, arrays),
            "marks": _marks(axis)}


def _bands(axis: Any, arrays: Arrays) -> list[Json]:
    """Return what `drawing.band` has filled as JSON."""
    return [{"x": arrays.place(t, X_DIGITS), "low": arrays.place(low, Y_DIGITS), "high": arrays.place(high, Y_DIGITS),
             "label": _words(each.get_label()), "color": to_hex(each.get_facecolor()[0])}
            for each in axis.collections for t, low, high in [each.band]]


def _marks(axis: Any) -> list[Json]:
    """Return bands and lines across the panel, and words in it, as JSON."""
    across = {"x": axis.get_xaxis_transform(which="grid"), "y": axis.get_yaxis_transform(which="grid")}
    marks: list[Json] = []
    for name, column in (("x", 0), ("y", 1)):
        for patch in axis.patches:
            if patch.get_data_transform() == across[name]:
                ends = patch.get_patch_transform().transform(patch.get_path().vertices)[:, column]
                marks.append({"axis": name, "from": float(ends.min()), "to": float(ends.max()),
                              "color": to_hex(patch.get_facecolor())})
        marks += [{"axis": name, "from": float(line.get_data()[column][0]), "color": to_hex(line.get_color()),
                   "width": line.get_linewidth(), "dash": DASHES.get(line.get_linestyle(), [])}
                  for line in axis.lines if line.get_transform() == across[name]]
    for words in axis.texts:
        if isinstance(words, Annotation):
            x, y = map(float, words.xy)
            marks.append({"at": [x, y if words.xycoords == "data" else None], "words": words.get_text()})
    return marks


def _style(line: Any) -> tuple[Any, ...]:
    return to_hex(line.get_color()), line.get_linestyle(), line.get_linewidth(), line.get_marker()


def _words(text: str) -> str:
    """Return a text in one line, without matplotlib's markup."""
    return re.sub(r"\s+", " ", str(text).replace("$^2$", "\u00b2").replace("+-", "\u00b1"))


def _thinned(t: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the indices of at most MOST_POINTS points: the lowest and highest of each group of neighbours."""
    many = len(x) // (MOST_POINTS // 2)
    if len(x) <= MOST_POINTS:
        return np.arange(len(x))
    whole = many * (len(x) // many)
    rows = x[:whole].reshape(-1, many)
    ends = [np.argmin(np.where(np.isnan(rows), np.inf, rows), axis=1),
            np.argmax(np.where(np.isnan(rows), -np.inf, rows), axis=1)]
    first = many * np.arange(len(rows))
    return np.unique(np.concatenate([first + ends[0], first + ends[1], np.arange(whole, len(x))]))
