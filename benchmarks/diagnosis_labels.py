"""The labelled set of the diagnosis: read its cases from `diagnosis_set.toml`, and judge answers.

An answer is `right` if the case accepts it, `wrong` if it says what is not so, and `refused`
if neither: it finds nothing, cannot say what, or names a part.  Judging needs the row of an answer only, not
the log, so a label that is corrected judges existing rows.
"""

import re
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from sim.effects import CATALOGUE

SET = Path(__file__).with_name("diagnosis_set.toml")
NAMED = ("explained", "dominant")      # the verdicts that name causes
SAYS_NOTHING = ("unexplained", "consistent", "bad-data", "refused", "crashed")
SOURCES = ("hidden", "simulated", "rebuilt", "foreign", "log")
PARTS = ("held-out", "tuned", "judge")
LARGEST_SET = 3     # causes that an answer may leave open
ANYTHING = "anything"   # of `accepted`: whatever is not wrong
OTHERS = "others"   # of `never`: every cause that is neither accepted nor beside
OF_INPUT = ("control_effectiveness", "control_loss", "control_slope", "thrust_misalignment", "nozzle_inertia",
            "nozzle_sensor_bias", "lateral_drift")  # causes of the input, besides those of actuator and controller
KNOWN = {*CATALOGUE, *SAYS_NOTHING, ANYTHING, OTHERS}
OPTIONS = {"seed", "factor", "variant", "rate", "reference", "duration", "drop", "air", "period", "with", "as_command",
           "changes", "shift"}  # of `diagnosis_sources`
NORMAL_95 = 1.96
FAR = 3.0           # standard deviations from what is known, at which a size is off

Row = dict[str, Any]       # an answer: see `diagnosis_set.answered`
Names = tuple[str, ...]
Range = tuple[float, float]


@dataclass(frozen=True)
class Case:
    """One log with its nominal, and the answers that are right or wrong for it.

    source     what the log is (see `diagnosis_sources`); its options, and the nominal's name
    accepted   right answers: a verdict that names nothing, or "a+b": every one of these causes is named, and nothing
               that is wrong; "a/b": one of them; "missing_term(beta^2)": this very term
    beside     names that are right too
    never      what is wrong: causes, terms, verdicts; `others`: all causes that are neither accepted nor beside
    sizes      {"cause.parameter": (from, to)} as known; a generator's flights tell theirs
    part       held-out: nothing was chosen on it; tuned: something was; judge: nothing ever may be, so it is not run
    identify   what `identify` is asked over the whole of a measured log and what is known: library, a6, k1 (from, to)
    in_tests   whether it is one of those that every run of the tests answers
    """

    name: str
    group: str
    kind: str
    source: tuple[str, str]
    nominal: str
    accepted: Names
    options: dict[str, Any] = field(default_factory=dict)
    beside: Names = ()
    never: Names = (OTHERS,)
    sizes: dict[str, Range] = field(default_factory=dict)
    identify: dict[str, Any] = field(default_factory=dict)
    part: str = "held-out"
    in_tests: bool = False
    words: str = ""


TAKEN = {each.name for each in fields(Case)} - {"source", "options", "group"}


def read_set() -> tuple[list[Case], dict[str, Any]]:
    """Return the cases in the order of the file, and the nominals that it brings: {name: TOML table}.  ValueError
    naming the case if a part of it is unknown, missing or there twice."""
    table = tomllib.loads(SET.read_text(encoding="utf-8"))
    cases: list[Case] = []
    for group, of_group in table["groups"].items():
        cases += [_case(group, each, of_group, table.get("named", {})) for each in of_group["cases"]]
    names = [each.name for each in cases]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise ValueError(f"{SET.name}: {', '.join(sorted(twice))}: expected a name of its own for each case")
    return cases, table["nominals"]


def _case(group: str, given: dict[str, Any], of_group: dict[str, Any], sets: dict[str, list[str]]) -> Case:
    """Return a case from its own table and its group's; ValueError naming it if a part is wrong."""
    both = {key: value for key, value in (of_group | given).items() if key != "cases"} \
        | {"words": given.get("words", "")}
    name = f"{group}/{given['name']}"
    source = [(key, both.pop(key)) for key in SOURCES if key in both]
    if len(source) != 1:
        raise ValueError(f"{name}: expected one of {', '.join(SOURCES)}")
    values = {key: both.pop(key) for key in TAKEN & set(both)} | {"name": name, "group": group, "source": source[0]}
    for key in ("accepted", "beside", "never"):
        values[key] = tuple(_spread(each, sets) for each in values.get(key, [OTHERS] if key == "never" else []))
    if not values["accepted"] and source[0][0] == "hidden" and source[0][1]:
        values["accepted"] = (source[0][1],)     # every cause that the generator hides
    if not values["accepted"] or values.get("part", "held-out") not in PARTS:
        raise ValueError(f"{name}: expected accepted answers, and a part out of {', '.join(PARTS)}")
    unknown = {each for key in ("accepted", "beside", "never") for each in _names(values[key])
               if each.partition("(")[0] not in KNOWN} | set(both) - OPTIONS
    if unknown:
        raise ValueError(f"{name}: {', '.join(sorted(unknown))}: no cause, no verdict and no option of a case")
    values["sizes"] = {key: (float(low), float(high)) for key, (low, high) in values.get("sizes", {}).items()}
    return Case(**values, options=both)


def _spread(name: str, sets: dict[str, list[str]]) -> str:
    """Return the name with "@SET" replaced by the names of that set of the file."""
    return re.sub(r"@(\w+)", lambda found: "/".join(sets[found[1]]), name)


def _names(of: Iterable[str]) -> set[str]:
    """Return the single names in answers: "a+b/c" has three."""
    return {name for each in of for name in re.split(r"[+/]", each)}


# ---- judging


def outcome(case: Case, row: Row) -> str:
    """Return "right", "wrong" or "refused" for an answer's row; a diagnosis that crashed is wrong."""
    if row["verdict"] == "crashed" or wrong_names(case, row) or row["verdict"] in case.never:
        return "wrong"
    return "right" if any(each == ANYTHING or _is_answer(each, row) for each in case.accepted) else "refused"


def _is_answer(accepted: str, row: Row) -> bool:
    """Whether the row says this: each cause in a set that is not too large, and "unexplained" at a place that is right
    for what the generator has hidden."""
    if row["verdict"] not in NAMED:
        return accepted == row["verdict"] and (row["verdict"] != "unexplained" or not row["places"]
                                               or row["where"] in row["places"])
    if accepted in SAYS_NOTHING:
        return False
    left = [answer for answer in row["named"] if len(answer["alike"]) < LARGEST_SET]
    for wanted in accepted.split("+"):
        hit = next((answer for answer in left if set(wanted.split("/")) & names_in(answer)), None)
        if hit is None:
            return False
        left.remove(hit)
    return True


def names_in(answer: dict[str, Any]) -> set[str]:
    """Return the names that count for a named cause: its own, with its term, and those it is not told from."""
    own = {answer["cause"]} | ({f"{answer['cause']}({answer['term']})"} if answer["term"] else set())
    return own | set(answer["alike"])


def wrong_names(case: Case, row: Row) -> list[str]:
    """Return the names in the answer that are wrong for the case."""
    right, never = _names((*case.accepted, *case.beside)), _names(case.never)
    named = row["named"] if row["verdict"] in NAMED else []
    wrong = []
    for answer in named:
        names = names_in(answer)
        if names & right:
            continue
        if OTHERS in never or names & never:
            wrong.append(f"{answer['cause']}({answer['term']})" if answer["term"] else answer["cause"])
    return wrong


def is_of_input(answer: dict[str, Any]) -> bool:
    """Whether a named cause acts on the input (actuator, controller, nozzle): a placebo must not have one."""
    return answer["where"] in ("actuator", "controller") or answer["cause"] in OF_INPUT or "beta" in answer["term"]


def sizes(case: Case, row: Row) -> Iterator[tuple[str, float, float]]:
    """Yield (cause.parameter, distance from the known size, its std) of each right name whose size is known."""
    known = case.sizes or {key: (value, value) for key, value in row["truth"].items()}
    for answer in row["named"] if row["verdict"] in NAMED else []:
        for parameter, (value, std) in answer["sizes"].items():
            key = f"{answer['cause']}.{parameter}"
            if key in known and value is not None:
                low, high = known[key]
                yield key, max(low - value, value - high, 0.0), std or 0.0


def said(row: Row) -> str:
    """Return the answer in one line: verdict, names with what they are not told from, first sizes."""
    words = []
    for answer in row["named"]:
        name = f"{answer['cause']}({answer['term']})" if answer["term"] else answer["cause"]
        size = next(iter(answer["sizes"].values()), None)
        number = f" {size[0]:.3g}" + (f" +- {size[1]:.1g}" if size[1] is not None else "") \
            if size and size[0] is not None else ""
        words.append("/".join((name, *answer["alike"])) + number)
    place = f" at {row['where']}" if row["where"] and not words else ""
    return f"{row['verdict']}{place}" + (f": {', '.join(words)}" if words else "")
