"""The labelled set asked of the diagnosis of old and of the new one, with the same words and judge.

    python benchmarks/diagnosis_versions.py --version new --out NEW.jsonl [--cases NAME...] [--folder DIR...]
    python benchmarks/diagnosis_versions.py --version old --out OLD.jsonl
    python benchmarks/diagnosis_set.py --compare OLD.jsonl NEW.jsonl

Answers are lines of `diagnosis_set.py`'s own form, one as it comes; what FILE holds already is not asked again.
"""

import argparse
import json
import sys
import time
import traceback
from pathlib import Path
from typing import Any

from diagnosis_labels import outcome, read_set, said
from diagnosis_set import asked, chosen, in_turn, named, read_rows
from diagnosis_sources import Absent, material


def answer(version: str, log: Any, nominal: Any) -> dict[str, Any]:
    """The contract's JSON of one version."""
    if version == "old":
        from launchid.diagnosis.report.answer import report as of_old
        from launchid.diagnosis.verdict import diagnose as old
        return of_old(old(log, nominal))
    from launchid.greybox.answer import report
    from launchid.greybox.verdict import diagnose
    return report(diagnose(log, nominal))


def main() -> int:
    """Ask, print each answer, count."""
    cases, nominals = read_set()
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--version", choices=("old", "new"), default="new")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE")
    parser.add_argument("--groups", nargs="+", default=[])
    parser.add_argument("--kinds", nargs="+", default=[])
    parser.add_argument("--cases", nargs="+", default=[], metavar="NAME", help="whose names hold one of these")
    parser.add_argument("--tenth", action="store_true")
    parser.add_argument("--judge", action="store_true")
    parser.add_argument("--folder", nargs="+", type=Path, default=[], metavar="DIR", help="of further measured logs")
    args = parser.parse_args()
    there = {row["case"] for row in read_rows(args.out)}
    counts = {"right": 0, "wrong": 0, "refused": 0}
    for case in in_turn([each for each in chosen(cases, args) if each.name not in there]):
        try:
            made = material(case, nominals, tuple(args.folder))
        except Absent as absent:
            print(f"{case.name}: skipped: {absent}", flush=True)
            continue
        begun = time.process_time()
        try:
            found = answer(args.version, made.log, made.nominal)
        except Exception as error:  # one case's crash is its row's, not the run's
            traceback.print_exc()
            found = {"verdict": "crashed", "doubts": [repr(error)]}
        row = {"case": case.name, "sources": args.version, "asked": asked(case, nominals), "verdict": found["verdict"],
               "where": found.get("where"), "seconds": round(time.process_time() - begun, 3), "rows": len(made.log.t),
               "named": [named(cause) for cause in found.get("causes", ())],
               "nearest": [each["resembles"] for each in found.get("nearest", ())],
               "doubts": [*found.get("doubts", ()), *found.get("remaining", ())], "remainder": found.get("remainder"),
               "cut_short": False, "truth": made.truth, "places": list(made.places), "limits": {}}
        with args.out.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
        how = outcome(case, row)
        counts[how] += 1
        print(f"{how:7} {case.name}: {said(row)}  [{row['seconds']:.1f} s]", flush=True)
    print(counts)
    return int(counts["wrong"] > 0)


if __name__ == "__main__":
    sys.exit(main())
