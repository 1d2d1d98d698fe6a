"""The base class of every command's result."""

import json
from collections.abc import Sequence
from typing import Any

from sim.result import Columns, Result


class Answer(Result):
    """Base class of a command's result: a `sim.result.Result` with the command's JSON (`report`) and warnings."""

    report: dict[str, Any]
    warnings: tuple[str, ...] = ()

    def columns(self) -> Columns:
        """Return the result's numbers as columns of equal length, by name; a subclass defines them."""
        raise NotImplementedError

    def table(self) -> Columns:
        """Return `columns()`, the table that `Result` asks for."""
        return self.columns()

    def to_json(self) -> str:
        """Return `report` as JSON text, as the command writes it."""
        return json_text(self.report)


def json_text(report: Any) -> str:
    """Return a JSON value as the commands write it."""
    return json.dumps(report, indent=1)


def flat(rows: Sequence[dict[str, Any]], prefix: str = "") -> Columns:
    """Return rows of a JSON as columns by name; a nested object's names are joined by `_`, what a row lacks is None."""
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
