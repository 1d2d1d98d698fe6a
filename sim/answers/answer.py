"""What every result can do."""

import json
from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import UsageError, extra_needed
from ..shown import html_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Columns = dict[str, list[Any]]


class Answer:
    """What every result can do; a class of its own says how."""

    report: dict[str, Any]
    warnings: tuple[str, ...] = ()

    def summary(self) -> str:
        """What the command prints."""
        raise NotImplementedError

    def columns(self) -> Columns:
        """The answer as columns of equal length."""
        raise NotImplementedError

    def _figure(self) -> "Figure":
        raise UsageError(f"{type(self).__name__.lower()}: there is nothing to draw")

    def plot(self, path: str | Path | None = None) -> "Figure":
        """The answer as a matplotlib figure, written to a .png, .svg or .pdf if there is a path."""
        return drawn(self._figure, path)

    def to_frame(self) -> Any:
        """The columns as a pandas DataFrame."""
        try:
            import pandas
        except ModuleNotFoundError as error:
            raise extra_needed(error) from None
        return pandas.DataFrame(self.columns())

    def to_json(self) -> str:
        """The report as the command writes it."""
        return json.dumps(self.report, indent=1)

    def _repr_html_(self) -> str:
        first, *rest = self.summary().splitlines()
        return (f"<p><b>{escape(first)}</b></p>{html_table(self.columns())}"
                f"<details><summary>as text</summary><pre>{escape(chr(10).join(rest))}</pre></details>")


def drawn(make: Callable[[], "Figure"], path: str | Path | None) -> "Figure":
    """A figure, written if there is a path; UsageError for a path that is no picture's, and without matplotlib."""
    try:
        from ..plots import check_suffix, save
        if path is not None:
            check_suffix(path)
        figure = make()
    except ModuleNotFoundError as error:
        raise extra_needed(error) from None
    if path is not None:
        save(figure, path)
    return figure


def flat(rows: Sequence[dict[str, Any]], prefix: str = "") -> Columns:
    """Rows of a JSON as columns: nested objects joined by `_`; what a row lacks is None."""
    flat = [_flattened(row, prefix) for row in rows]
    names = list(dict.fromkeys(name for row in flat for name in row))
    return {name: [row.get(name) for row in flat] for name in names}


def _flattened(row: dict[str, Any], prefix: str) -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in row.items():
        if isinstance(value, dict):
            flat |= _flattened(value, f"{prefix}{name}_")
        else:
            flat[prefix + name] = value
    return flat
