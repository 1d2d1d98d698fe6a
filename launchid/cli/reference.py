"""Reference of the catalogue of effects (`launchid effects`), and of every command with its options (docs/commands.md).

`docs/commands.md` is `commands_page` of the parser; after a change of words: `write_page(parser(), "docs/commands.md")`
of `launchid.main.parser`.  The table of causes in `docs/formats.md` is `causes_table`; after a change:
`write_causes("docs/formats.md")`.
"""

import argparse
from pathlib import Path
from typing import Any

from sim.effects import CATALOGUE, Parameter
from sim.files import write_text
from sim.result import Columns

from ..formatting import json_number
from ..report.answer import Answer, flat

PAGE_HEAD = """# Commands

Every command with all its options, as `launchid COMMAND --help` says them; this page is made from the same words.
Files, units and exit status are in [formats](formats.md), the same from Python in [python](python.md).

Completion in the shell: `pip install 'launchid[completion]'`, then in the profile of bash or zsh
`eval "$(register-python-argcomplete launchid)"`.
"""


# ---- effects


def effects_report() -> dict[str, Any]:
    """Return the catalogue of effects for JSON: name, place, meaning and parameters of each."""
    return {"effects": [{
        "effect": name, "where": cause.where, "diagnosed": True, "meaning": cause.meaning,
        "parameters": [_parameter_json(parameter) for parameter in cause.parameters]}
        for name, cause in CATALOGUE.items()]}


def _parameter_json(parameter: Parameter) -> dict[str, Any]:
    left_out = parameter.default if parameter.neutral is None else parameter.neutral
    limits = {name: json_number(value)
              for name, value in (("low", parameter.low), ("high", parameter.high))}
    return {"name": parameter.name, "unit": parameter.unit, "required": parameter.is_required,
            "default": json_number(left_out), **limits,
            "expected": parameter.expected}


def causes_table() -> list[str]:
    """Return the table of causes in docs/formats.md, line by line."""
    lines = ["| where | cause | parameters: unit (neutral value) | meaning |", "|---|---|---|---|"]
    for name, cause in CATALOGUE.items():
        said = []
        for of in cause.parameters:
            value = f" ({of.neutral:g})" if of.neutral is not None else \
                f" (default {of.default:g})" if of.default is not None else ""
            said.append(f"`{of.name}`" + (f" {of.unit}" if of.unit and not of.is_term else "") + value)
        lines.append(f"| {cause.where} | `{name}` | {', '.join(said)} | {cause.meaning} |")
    return lines


def write_causes(path: str | Path) -> None:
    """Write the table of causes anew into docs/formats.md."""
    lines = Path(path).read_text(encoding="utf-8").splitlines()
    table = causes_table()
    first = lines.index(table[0])
    end = next(k for k in range(first, len(lines)) if not lines[k].startswith("|"))
    write_text(path, ["\n".join([*lines[:first], *table, *lines[end:]]), "\n"])


def effects_table() -> str:
    """Return the catalogue of effects as text for a terminal."""
    lines = ["Causes that `simulate --effect NAME:PARAMETER=VALUE,...` and [[effects]] fly and `diagnose` looks for.",
             "u is the command on its way to the actuator, b the true nozzle angle, z_ the measured signals."]
    for name, cause in CATALOGUE.items():
        lines += ["", f"{name}  [{cause.where}]", f"    {cause.meaning}"]
        lines += [f"    {parameter.name}: {_in_words(parameter)}" for parameter in cause.parameters]
    return "\n".join(lines)


def _in_words(parameter: Parameter) -> str:
    if parameter.is_required:
        return f"{parameter.expected}; required"
    return f"{parameter.expected}; default {parameter.default if parameter.neutral is None else parameter.neutral:g}"


class Effects(Answer):
    """The catalogue of effects as a command's result."""

    def __init__(self) -> None:
        self.report = effects_report()

    def summary(self) -> str:
        return effects_table()

    def columns(self) -> Columns:
        rows = [{"effect": row["effect"], "where": row["where"], "parameter": each["name"], "unit": each["unit"],
                 "default": each["default"], "expected": each["expected"], "meaning": row["meaning"]}
                for row in self.report["effects"] for each in row["parameters"]]
        return flat(rows)


# ---- commands


def commands_page(parser: argparse.ArgumentParser) -> str:
    """Return a page of Markdown with every command of the parser and its options."""
    (commands,) = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    parts = [PAGE_HEAD]
    for name, sub in commands.choices.items():
        needed = [_word(action) for action in sub._actions if action.required]
        rows = [f"| {_words(action)} | {_cell(_help(action, sub))} |" for action in sub._actions
                if not isinstance(action, argparse._HelpAction)]
        parts.append("\n".join([f"## {name}", "", (sub.description or "").removeprefix(f"{name}: "), "",
                                "```sh", " ".join([sub.prog, *needed, "[OPTION...]"]), "```", "",
                                "| word | meaning |", "|---|---|", *rows, "",
                                (sub.epilog or "").replace("example: ", "Example: `", 1) + "`", ""]))
    return "\n".join(parts)


def _word(action: argparse.Action) -> str:
    """Return `--option VALUE` of an option, or the name of a positional argument."""
    value = "" if action.nargs == 0 else str(action.metavar or "|".join(map(str, action.choices or ())))
    return " ".join([*action.option_strings[-1:], value]).strip()


def _words(action: argparse.Action) -> str:
    return f"`{_cell(_word(action))}`" + (" (required)" if action.required and action.option_strings else "")


def _help(action: argparse.Action, parser: argparse.ArgumentParser) -> str:
    return (action.help or "") % {**vars(action), "prog": parser.prog}


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def write_page(parser: argparse.ArgumentParser, path: str | Path) -> None:
    """Write the page of all commands of the parser (docs/commands.md) to `path`."""
    write_text(path, [commands_page(parser)])
