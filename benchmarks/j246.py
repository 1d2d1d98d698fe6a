"""A foreign launcher as judge, JSBSim's J246: are hidden faults named, how large, is a true nominal consistent?

    python benchmarks/j246.py [--cases NAME...] [--seeds FIRST COUNT] [--plain] [--gamma] [--pole RATE]
                              [--keep DIR] [--json PATH]

Needs the `jsbsim` package (extra `judges`); flights, faults and nominals are those of `tests/foreign`.  Cases: six
kinds if left out (weak_gimbal, k1_wrong, gust, slow_servo, gyro_bias, engine_out) and calm; `all`: every one.
Seeds below 1000 are for building, from 1000 on for judging: choose nothing on them.  A case is `right` where its cause
is named, `alike` where the report says of a name that it cannot be told from it; a name is wrong that is neither,
nor a look-alike of the case.  A size's error is relative to its distance from neutral (a scale's from 1).
--plain: nominals without [drift] and [wind] and with a second-order servo.  --gamma: logs with the flight path as
navigation has it.  --pole: nominals whose servo, of first order at 60 rad/s, is written as one of second order with
this second pole [rad/s].  --keep: logs and nominals stay in DIR.
"""

import argparse
import contextlib
import dataclasses
import json
import math
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from foreign import j246_cases
from foreign.j246_cases import CASES, SIX, Case

from launchid.diagnosis.answer import report
from launchid.diagnosis.verdict import diagnose
from launchid.log.log import read_log
from sim.errors import InputError
from sim.nominal import load_nominal

NAMED = ("explained", "dominant")
DEMANDED = {"right": 0.9, "wrong": 0, "size": 0.1, "consistent": 36 / 40}


@contextlib.contextmanager
def folder(keep: Path | None) -> Iterator[Path]:
    """The folder into which logs and nominals are written."""
    if keep is not None:
        keep.mkdir(parents=True, exist_ok=True)
        yield keep
        return
    with tempfile.TemporaryDirectory() as made:
        yield Path(made)


def judged(name: str, seed: int, where: Path, plain: bool = False, navigated: bool = False,
           pole: float | None = None) -> dict[str, Any]:
    """One flight: flown, written, diagnosed, compared."""
    of, flight = j246_cases.flown(name, seed)
    log, nominal = where / f"{name}_{seed}.csv", where / f"{name}_{seed}.toml"
    j246_cases.write_log(log, flight, navigated)
    j246_cases.write_nominal(nominal, of, seed, plain, pole=pole)
    begun = time.perf_counter()
    try:
        result = report(diagnose(read_log(log), load_nominal(nominal)))
    except InputError as error:
        result = {"verdict": "refused", "causes": [], "nearest": [], "why": str(error)}
    except Exception as error:  # one flight's crash is its row's, not the campaign's
        traceback.print_exc()
        result = {"verdict": "crashed", "causes": [], "nearest": [], "why": repr(error)}
    return {"case": name, "seed": seed, "seconds": time.perf_counter() - begun, "known": dataclasses.asdict(of),
            "diagnose": result, **compared(of, result)}


def compared(of: Case, result: dict[str, Any]) -> dict[str, Any]:
    """right: strictly named; alike: or not told from it; wrong: other names; error: relative, of the first cause."""
    causes = result["causes"] if result["verdict"] in NAMED else []
    names = [cause["cause"] for cause in causes]
    alike = {other for cause in causes for other in cause["indistinguishable_from"]}
    right = bool(set(of.causes) & set(names))
    told = right or bool(set(of.causes) & alike)
    wrong = [cause["cause"] for cause in causes
             if cause["cause"] not in of.causes + of.look_alikes
             and not set(cause["indistinguishable_from"]) & set(of.causes)]
    size = [cause["parameters"][of.parameter]["value"] for cause in causes
            if of.causes and cause["cause"] == of.causes[0] and of.parameter in cause["parameters"]]
    error = abs(size[0] - of.size) / abs(of.size - neutral(of.parameter)) if size and math.isfinite(of.size) else None
    return {"right": right, "told": told, "wrong": wrong, "error": error,
            "consistent": result["verdict"] == "consistent"}


def neutral(parameter: str) -> float:
    """A scale's size is its distance from 1."""
    return 1.0 if parameter == "scale" else 0.0


def line(row: dict[str, Any]) -> str:
    """The line printed of one flight."""
    result, known = row["diagnose"], row["known"]
    wanted = f"{known['causes'][0]} {known['parameter']} {known['size']:.4g}" if known["causes"] else "consistent"
    good = row["consistent"] if not known["causes"] else row["told"]
    mark = "WRONG" if row["wrong"] else "right" if good else "missed"
    said = "; ".join(map(sizes, result["causes"])) if result["causes"] else \
        result.get("why") or "nearest " + ", ".join(each["resembles"] for each in result.get("nearest", []))
    remainder = result.get("remainder")
    return (f"{row['case']:16} {row['seed']:5} {mark:6} {row['seconds']:5.0f} s  {result['verdict']:11} "
            f"wanted {wanted}: {said}" + (f"  [error {100 * row['error']:.1f} %]" if row["error"] is not None else "")
            + (f"  [remainder {remainder['share']:.2f} {remainder['where']}]" if remainder else ""))


def sizes(cause: dict[str, Any]) -> str:
    """A cause with its parameters."""
    said = []
    for name, of in cause["parameters"].items():
        value, std = of["value"], of["std"]
        text = value if isinstance(value, str) else "?" if value is None else f"{value:.4g}"
        said.append(f"{name} {text}" + (f" +- {std:.2g}" if std is not None else ""))
    alike = cause["indistinguishable_from"]
    return f"{cause['cause']} ({', '.join(said)}" + (f"; or {', '.join(alike)}" if alike else "") + ")"


def table(rows: list[dict[str, Any]]) -> list[str]:
    """The table by case, and over all."""
    said = [f"{'case':16} flights  right  alike  wrong  consistent  size error (median)  seconds (median)"]
    faulty = [row for row in rows if row["known"]["causes"]]
    true = [row for row in rows if not row["known"]["causes"]]
    for name in dict.fromkeys(row["case"] for row in rows):
        said.append(counts(name, [row for row in rows if row["case"] == name]))
    if faulty:
        said.append(counts("all with a fault", faulty) + f"   demanded: right {DEMANDED['right']:.0%}, wrong "
                    f"{DEMANDED['wrong']}, size {DEMANDED['size']:.0%}")
    if true:
        said.append(counts("true nominals", true) + f"   demanded: consistent {DEMANDED['consistent']:.0%}")
    return said


def counts(name: str, rows: list[dict[str, Any]]) -> str:
    """One line of the table."""
    errors = [row["error"] for row in rows if row["error"] is not None]
    middle = f"{100 * float(np.median(errors)):.1f} %" if errors else "-"
    return (f"{name:16} {len(rows):7} {sum(row['right'] for row in rows):6} {sum(row['told'] for row in rows):6} "
            f"{sum(bool(row['wrong']) for row in rows):6} {sum(row['consistent'] for row in rows):11} {middle:>20} "
            f"{float(np.median([row['seconds'] for row in rows])):17.0f}")


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", nargs="+", default=[*SIX, "calm"], choices=[*CASES, "all"], metavar="NAME")
    parser.add_argument("--seeds", nargs=2, type=int, default=(0, 1), metavar=("FIRST", "COUNT"))
    parser.add_argument("--plain", action="store_true", help="nominals for commands without drift and wind")
    parser.add_argument("--gamma", action="store_true", help="logs with the column gamma")
    parser.add_argument("--pole", type=float, metavar="RATE", help="rad/s, second pole of the nominals' servo")
    parser.add_argument("--keep", type=Path, metavar="DIR")
    parser.add_argument("--json", type=Path, metavar="PATH")
    args = parser.parse_args()
    first, count = args.seeds
    rows = []
    with folder(args.keep) as where:
        for name in CASES if "all" in args.cases else args.cases:
            for seed in range(first, first + count):
                rows.append(judged(name, seed, where, args.plain, args.gamma, args.pole))
                print(line(rows[-1]), flush=True)
    print("\n".join(table(rows)))
    if args.json:
        args.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
