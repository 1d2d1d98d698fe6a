"""The base class of every answer."""

import json
from collections.abc import Sequence
from typing import Any

from sim.result import Columns, Result


class Answer(Result):
    """The members that every answer has beside a result's; each answer is a class of its own."""

    report: dict[str, Any]
    warnings: tuple[str, ...] = ()

    def columns(self) -> Columns:
        """The answer as columns of equal length."""
        raise NotImplementedError

    def table(self) -> Columns:
        """The same, as any result has it."""
        return self.columns()

    def to_json(self) -> str:
        """The report as the command writes it."""
        return json.dumps(self.report, indent=1)


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
