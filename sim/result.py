"""Base class of results, logs and nominals: summary text, table, figure, and their page in a notebook."""

import functools
import math
import sys
from collections.abc import Callable
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .errors import UsageError, extra_needed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Columns = dict[str, list[Any]]
NOTEBOOK_ROWS = 40  # of a table in a notebook
PAGE_DPI = 72  # of a figure on a notebook's page: half the bytes of one that is written


class Result:
    """Base of what users get back; a subclass implements `summary`, `table` and, if it can be drawn, `_figure`."""

    def __init_subclass__(cls, **more: Any) -> None:
        """Keep a dataclass from writing all of its arrays as its `repr`."""
        super().__init_subclass__(**more)
        if "__repr__" not in cls.__dict__:
            cls.__repr__ = Result.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self._headline()}>"

    def _headline(self) -> str:
        """Return the result in one line."""
        said = getattr(self, "report", {}).get("headline") or self.summary()
        return str(said).splitlines()[0]

    def summary(self) -> str:
        """Return the result in words, the most important line first."""
        raise NotImplementedError

    def table(self) -> Columns:
        """Return the result as columns of equal length, name -> list."""
        raise NotImplementedError

    def _figure(self) -> "Figure":
        raise UsageError(f"{type(self).__name__.lower()}: there is nothing to draw")

    def plot(self, path: str | Path | None = None) -> "Figure":
        """Return a matplotlib figure, which a notebook shows; also write it if `path` is given (.png, .svg, .pdf)."""
        return drawn(self._figure, path)

    def to_frame(self) -> Any:
        """Return the table as a pandas DataFrame, None as NaN in a column of None only; UsageError without pandas."""
        try:
            import pandas
        except ModuleNotFoundError as error:
            raise extra_needed(error) from None
        return pandas.DataFrame({name: [math.nan] * len(x) if all(each is None for each in x) else x
                                 for name, x in self.table().items()})

    def _repr_html_(self) -> str:
        first, rest = self._headline(), self.summary().splitlines()
        rest = rest[1:] if rest[:1] == [first] else rest
        more = f"<details><summary>as text</summary><pre>{escape(chr(10).join(rest))}</pre></details>" if rest else ""
        return f"<p><b>{escape(first)}</b></p>{_html_table(self.table())}{more}"


def drawn(make: Callable[[], "Figure"], path: str | Path | None) -> "Figure":
    """Return the figure of `make`, written if there is a path; UsageError for another suffix, or without matplotlib."""
    try:
        from .canvas import check_suffix, save
        if path is not None:
            check_suffix(path)
        figure = make()
    except ModuleNotFoundError as error:
        raise extra_needed(error) from None
    if path is not None:
        save(figure, path)
    pyplot = sys.modules.get("matplotlib.pyplot")
    if pyplot is not None:  # of a figure that it made it would open a window, or show it a second time
        pyplot.close(figure)
    figure.__dict__["_repr_png_"] = functools.partial(_png, figure)
    return figure


def _png(figure: "Figure") -> bytes:
    from .canvas import png_of
    return png_of(figure, PAGE_DPI)


def _html_table(columns: dict[str, list[Any]]) -> str:
    """Return columns of equal length as an HTML table; rows beyond NOTEBOOK_ROWS are only counted."""
    rows = len(next(iter(columns.values()), []))
    shown = zip(*(x[:NOTEBOOK_ROWS] for x in columns.values()), strict=True)
    head = "".join(f"<th>{escape(name)}</th>" for name in columns)
    body = "".join(f"<tr>{''.join(f'<td>{_cell(x)}</td>' for x in row)}</tr>" for row in shown)
    more = f"<p>... and {rows - NOTEBOOK_ROWS} more rows</p>" if rows > NOTEBOOK_ROWS else ""
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{more}"


def _cell(x: Any) -> str:
    if x is None or (isinstance(x, float) and math.isnan(x)):
        return "-"
    return f"{x:.{5}g}" if isinstance(x, float) else escape(str(x))
