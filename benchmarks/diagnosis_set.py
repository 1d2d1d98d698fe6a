"""The diagnosis on its labelled set: right, wrong and refused answers by group and by kind; what a change changes.

    python benchmarks/diagnosis_set.py [--groups G...] [--kinds K...] [--cases NAME...] [--tenth] [--judge]
                                       [--folder DIR...] [--jobs 2] [--out FILE] [--fresh FIRST COUNT]
    python benchmarks/diagnosis_set.py --table FILE
    python benchmarks/diagnosis_set.py --compare BEFORE AFTER

`diagnosis_set.toml` holds the cases: a log or the seed of a flight, a nominal, the answers that are right, what must
never be said.  right: an accepted answer; wrong: what is not so is said; refused: neither (nothing, no name, a part).
far: right names whose size is more than 3 of its standard deviations from what is known, of those that have both; and
the share whose 95 % interval holds it.  Seconds are of processor time, of the diagnosis alone.

Answers go to FILE, a JSON line each as they come (default: diagnosis-benchmark/set-DIGEST.jsonl, DIGEST of the sources
that decide an answer); what stands there under the same sources and case is not asked again, so that a run that is
interrupted goes on, and another choice of cases adds to it.  Labels are not part of it: a table or a comparison judges
the answers by the labels of today.  --compare prints both side by side and every case whose outcome differs; exit
status 1 where an answer got worse (right before, or wrong only now).  Without it: 1 where an answer is wrong.

Cases whose log is not here are skipped, with a line: measured logs that may not be passed on lie in a --folder
(`real_suite.py`), J246 needs the extra `judges`.  What only judges (part "judge") runs with --judge alone: nothing
may be chosen on it.

--fresh FIRST COUNT: so many flights of the set's own kinds with other seeds, from FIRST on, at 25, 50, 100 and 200 Hz
in turn: flights that nobody has seen, judged by the labels of their kind.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: two workers share the machine, not four threads

import argparse
import contextlib
import dataclasses
import functools
import hashlib
import json
import signal
import sys
import time
import traceback
from collections import Counter
from collections.abc import Iterable, Iterator
from multiprocessing import Pool
from pathlib import Path
from typing import Any

import numpy as np
from diagnosis_labels import FAR, NORMAL_95, Case, Row, is_of_input, outcome, read_set, said, sizes, wrong_names
from diagnosis_sources import ROOT, Absent, material

from launchid.cli.terminal import shown_counter
from launchid.diagnosis.answer import report
from launchid.diagnosis.verdict import diagnose
from launchid.log.log import flown_log
from sim.errors import InputError, UsageError
from sim.flight import fly_whole
from sim.nominal import load_nominal

DECIDES = ("launchid_core", "sim", "launchid", "tests/hidden", "tests/foreign", "tests/public")  # decide an answer
AND_FILES = ("tests/public_flights.py", "benchmarks/diagnosis_sources.py")
OUTCOMES = ("right", "wrong", "refused")
JUDGED = "judge"   # the part that is run on demand alone
RATES = (25.0, 50.0, 100.0, 200.0)   # Hz of fresh flights
WARM = 8.0         # s of the flight by which a worker loads the compiled code


# ---- one case


def answered(case: Case, nominals: dict[str, Any], folders: tuple[Path, ...], sources: str) -> Row:
    """Diagnose a case; return its row: the answer, its seconds, and what the generator knows.

    named   [{"cause", "term", "alike": [...], "where", "sizes": {parameter: [value, std]}, "nats", "removed"}]
    truth   {"cause.parameter": value} of a flight, with the limit that is printed for that cause in `limits`
    absent  why there is no log; then nothing else is there
    """
    row: Row = {"case": case.name, "sources": sources, "asked": asked(case, nominals)}
    try:
        there = material(case, nominals, folders)
    except Absent as absent:
        return row | {"absent": str(absent)}
    begun = time.process_time()
    try:
        said_of_it = report(diagnose(there.log, there.nominal))
    except (InputError, UsageError) as error:
        said_of_it = {"verdict": "refused", "doubts": [str(error)]}
    except Exception as error:  # one case's crash is its row's, not the run's
        traceback.print_exc()
        said_of_it = {"verdict": "crashed", "doubts": [repr(error)]}
    seconds = time.process_time() - begun
    limits = {key: said_of_it.get("limits", {}).get(key.partition(".")[0], {}).get("size") for key in there.truth}
    return row | {
        "verdict": said_of_it["verdict"], "where": said_of_it.get("where"), "seconds": round(seconds, 3),
        "rows": len(there.log.t), "named": [named(cause) for cause in said_of_it.get("causes", ())],
        "nearest": [each["resembles"] for each in said_of_it.get("nearest", ())],
        "doubts": said_of_it.get("doubts", []), "remainder": said_of_it.get("remainder"),
        "cut_short": said_of_it.get("cut_short", False), "truth": there.truth, "places": list(there.places),
        "limits": limits}


def named(cause: dict[str, Any]) -> dict[str, Any]:
    """Return the fields of a named cause that a row keeps."""
    term = cause["parameters"].get("term", {}).get("value")
    return {"cause": cause["cause"], "term": term or "", "alike": cause["indistinguishable_from"],
            "where": cause["where"], "nats": cause["evidence"]["nats"], "removed": cause["removed"],
            "sizes": {name: [value["value"], value["std"]] for name, value in cause["parameters"].items()
                      if not isinstance(value["value"], str)}}


def asked(case: Case, nominals: dict[str, Any]) -> str:
    """Return a hash of a case's log and nominal, not of its labels."""
    nominal = (case.nominal, nominals.get(case.nominal))
    return digest([repr((case.source, sorted(case.options.items()), *nominal)).encode()])


def sources_now() -> str:
    """Return a hash of the source files that decide an answer."""
    paths = [path for folder in DECIDES for path in sorted((ROOT / folder).rglob("*"))
             if path.suffix in (".py", ".toml", ".csv")]
    return digest(path.read_bytes() for path in (*paths, *(ROOT / name for name in AND_FILES)))


def digest(parts: Iterable[bytes]) -> str:
    """Return the first sixteen hexadecimal digits of the SHA-256 of all parts."""
    total = hashlib.sha256()
    for part in parts:
        total.update(part)
    return total.hexdigest()[:16]


# ---- all of them


def run(cases: list[Case], nominals: dict[str, Any], args: argparse.Namespace, path: Path) -> list[Row]:
    """Return the rows of these cases; those not yet in the file are diagnosed and appended.  Ctrl-C ends it early."""
    sources = sources_now()
    there = {row["case"]: row for row in read_rows(path) if row["sources"] == sources}
    there = {case.name: there[case.name] for case in cases
             if case.name in there and there[case.name]["asked"] == asked(case, nominals)}
    left = [case for case in cases if case.name not in there]
    print(f"{len(cases)} cases, {len(there)} of them answered already in {path}", flush=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    update = shown_counter(len(left), "cases")
    with path.open("a", encoding="utf-8") as file:
        try:
            for row in in_processes(in_turn(left), (nominals, tuple(args.folder), sources), args.jobs):
                update(1)
                if "absent" in row:
                    print(f"{row['case']}: skipped: {row['absent']}", flush=True)
                    continue
                file.write(json.dumps(row) + "\n")
                file.flush()
                there[row["case"]] = row
                if not sys.stderr.isatty():
                    print(f"{len(there):4} {row['case']}: {said(row)}  [{row['seconds']:.1f} s]", flush=True)
        except KeyboardInterrupt:
            print("interrupted: the same command goes on", file=sys.stderr)
    return [there[case.name] for case in cases if case.name in there]


def in_turn(cases: list[Case]) -> list[Case]:
    """Return the cases with each group's spread over the run, so that one cut short has some of every group."""
    groups = Counter(case.group for case in cases)
    number: Counter[str] = Counter()
    turn = []
    for case in cases:
        number[case.group] += 1
        turn.append((number[case.group] - 0.5) / groups[case.group])
    return [cases[k] for k in np.argsort(turn, kind="stable")]


def in_processes(cases: list[Case], given: tuple[Any, ...], jobs: int) -> Iterator[Row]:
    """Yield the rows as they come, from `jobs` processes, or from this one if jobs is 1."""
    work = functools.partial(_answered, given)
    if jobs <= 1 or len(cases) < 2:
        if cases:
            warmed()
        yield from map(work, cases)
        return
    with Pool(jobs, initializer=_begun) as pool:  # its end terminates the workers
        yield from pool.imap_unordered(work, cases)


def _answered(given: tuple[Any, ...], case: Case) -> Row:
    return answered(case, *given)


def _begun() -> None:
    """Prepare a worker: ignore Ctrl-C, which the starting process handles, and load the compiled code."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    warmed()


def warmed() -> None:
    """Load the compiled code of generator and diagnosis, so that no case's seconds include it."""
    nominal = load_nominal("constant")
    log = flown_log(fly_whole(nominal, 1), "warm")
    first = log.t < WARM
    diagnose(type(log)(log.path, log.columns, log.ignored, **{
        name: getattr(log, name)[first] for name in ("t", "theta", "theta_dot", "beta", "theta_ddot", "beta_cmd",
                                                     "theta_ref")}), nominal)


def read_rows(path: Path) -> list[Row]:
    """Return the rows of a file of answers, the last of each case; a line that was cut off is skipped."""
    rows: dict[str, Row] = {}
    if path.exists():
        for line in path.read_text(encoding="utf-8").splitlines():
            with contextlib.suppress(json.JSONDecodeError):
                row = json.loads(line)
                rows[row["case"]] = row
    return list(rows.values())


def still_asked(cases: list[Case], nominals: dict[str, Any], path: Path) -> list[Row]:
    """Return the rows of a file that answer these cases as they are today; print which had another log or nominal."""
    asks = {case.name: asked(case, nominals) for case in cases}
    rows = [row for row in read_rows(path) if row["case"] in asks]
    stale = [row["case"] for row in rows if row["asked"] != asks[row["case"]]]
    if stale:
        print(f"{path}: left out, the case is another one now: {', '.join(stale)}")
    return [row for row in rows if row["case"] not in stale]


# ---- tables


def table(cases: list[Case], runs: list[list[Row]]) -> list[str]:
    """Return the lines of the table by group, kind and part and over all; of two runs, both numbers in each cell."""
    by_name = [{row["case"]: row for row in rows} for rows in runs]
    shared = [case for case in cases if all(case.name in rows for rows in by_name)]
    lines = [_columns(["", "cases", *OUTCOMES, "far / sized", "within 95 %", "median s", "90 % s"], len(runs))]
    for title in ("group", "kind", "part"):
        lines.append(f"-- by {title}")
        lines += [line(name, [case for case in shared if getattr(case, title) == name], by_name)
                  for name in dict.fromkeys(getattr(case, title) for case in shared)]
    lines += ["--", line("all", shared, by_name)] if shared else []
    listed = [case for case in shared if case.group.startswith("listed")]
    lines += ["-- listed causes at twice a clearly visible size, by rate"] if listed else []
    for rate in RATES:
        of_rate = [case for case in listed if case.options.get("rate") == rate]
        lines += [line(f"{rate:g} Hz", of_rate, by_name)] if of_rate else []
    placebos = [case for case in shared if case.kind == "placebo"]
    if placebos:
        counts = [sum(any(map(is_of_input, rows[case.name]["named"])) for case in placebos) for rows in by_name]
        lines.append(f"placebos in which a cause of the input is named: {' -> '.join(map(str, counts))} "
                     f"of {len(placebos)}")
    return lines


def line(name: str, cases: list[Case], by_name: list[dict[str, Row]]) -> str:
    """Return one line of the table: a number of each run in each cell."""
    def count(wanted: str) -> list[str]:
        return [str(sum(outcome(case, rows[case.name]) == wanted for case in cases)) for rows in by_name]

    seconds = [np.percentile([rows[case.name]["seconds"] for case in cases], (50.0, 90.0)) for rows in by_name]
    sized = [far(cases, rows) for rows in by_name]
    return _columns([name, str(len(cases)), *(" > ".join(count(each)) for each in OUTCOMES),
                     *(" > ".join(filter(None, each)) for each in zip(*sized, strict=True)),
                     *(" > ".join(f"{each[k]:.1f}" for each in seconds) for k in (0, 1))], len(by_name))


def _columns(cells: list[str], runs: int) -> str:
    """Return cells as one line of the table, columns wide enough for this number of runs."""
    widths = (16, 5, *([9] * 3 if runs > 1 else [7] * 3), *([17, 13, 13, 13] if runs > 1 else [11, 11, 8, 8]))
    return f"{cells[0]:{widths[0]}} " + " ".join(f"{cell:>{width}}" for cell, width in
                                               zip(cells[1:], widths[1:], strict=True))


def far(cases: list[Case], rows: dict[str, Row]) -> tuple[str, str]:
    """Return ("sizes farther than FAR std / sizes", share within the 95 % interval) of these cases' right names."""
    of = [(away, std) for case in cases for _, away, std in sizes(case, rows[case.name])]
    if not of:
        return "", ""
    inside = sum(away <= NORMAL_95 * std for away, std in of) / len(of)
    return f"{sum(away > FAR * std for away, std in of)} / {len(of)}", f"{inside:.2f}"


def not_right(cases: list[Case], rows: list[Row]) -> Iterator[str]:
    """Yield a line for each case that is not right: the answer given, the answers accepted."""
    by_name = {row["case"]: row for row in rows}
    for case in cases:
        if case.name in by_name and (how := outcome(case, row := by_name[case.name])) != "right":
            wrong = wrong_names(case, row)
            yield (f"{how:7} {case.name}: {said(row)}" + (f"; WRONG {', '.join(wrong)}" if wrong else "")
                   + f"; accepted: {' or '.join(case.accepted)}" + (f" ({case.words})" if case.words else "")
                   + (f"; nearest {', '.join(row['nearest'])}" if row["nearest"] and not row["named"] else ""))


# ---- two runs


def compared(cases: list[Case], before: list[Row], after: list[Row]) -> tuple[list[str], bool]:
    """Return the lines that compare two runs, and whether an answer got worse."""
    lines, old, new = table(cases, [before, after]), {}, {}
    for rows, into in ((before, old), (after, new)):
        into.update({row["case"]: row for row in rows})
    shared = [case for case in cases if case.name in old and case.name in new]
    moved: dict[str, list[str]] = {"worse": [], "better": [], "other words": []}
    for case in shared:
        a, b = outcome(case, old[case.name]), outcome(case, new[case.name])
        words = f"{case.name}: {a} {said(old[case.name])}  ->  {b} {said(new[case.name])}"
        if a != b:
            moved["worse" if a == "right" or b == "wrong" else "better"].append(words)
        elif spoken(old[case.name]) != spoken(new[case.name]):
            moved["other words"].append(words)
    for title, said_of in moved.items():
        lines += ["", f"{title}: {len(said_of)}", *(f"  {each}" for each in said_of)]
    only = {"before": set(old) - set(new), "after": set(new) - set(old)}
    lines += [f"only {when}: {', '.join(sorted(names))}" for when, names in only.items() if names]
    return lines, bool(moved["worse"])


def spoken(row: Row) -> tuple[Any, ...]:
    """Return the verdict and the names of an answer, without sizes."""
    return (row["verdict"], *((each["cause"], each["term"], *each["alike"]) for each in row["named"]))


# ---- the command


def chosen(cases: list[Case], args: argparse.Namespace) -> list[Case]:
    """Return the cases that the command's options choose."""
    return [case for case in cases if (args.judge or case.part != JUDGED)
            and (not args.groups or case.group in args.groups) and (not args.kinds or case.kind in args.kinds)
            and (not args.cases or any(each in case.name for each in args.cases)) and (case.in_tests or not args.tenth)]


def fresh(cases: list[Case], first: int, count: int) -> list[Case]:
    """Return `count` cases of hidden flights of the set's kinds with new seeds, from `first` on, and RATES in turn."""
    hidden = [case for case in cases if case.source[0] == "hidden"]
    step = len(hidden) / count
    drawn = [hidden[int(k * step) % len(hidden)] for k in range(count)]
    return [dataclasses.replace(case, name=f"{case.name}@{first + k}", options=case.options | {
        "seed": first + k, "rate": RATES[k % len(RATES)]}) for k, case in enumerate(drawn)]


def main() -> int:
    """Run and print; exit status 1 where an answer is wrong or, of two runs, worse."""
    cases, nominals = read_set()
    groups, kinds = dict.fromkeys(case.group for case in cases), dict.fromkeys(case.kind for case in cases)
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--groups", nargs="+", choices=list(groups), metavar="G", help=", ".join(groups))
    parser.add_argument("--kinds", nargs="+", choices=list(kinds), metavar="K", help=", ".join(kinds))
    parser.add_argument("--cases", nargs="+", metavar="NAME", help="whose names (group/name) hold one of these")
    parser.add_argument("--tenth", action="store_true", help="those that every run of the tests answers")
    parser.add_argument("--judge", action="store_true", help="also those on which nothing may be chosen")
    parser.add_argument("--fresh", nargs=2, type=int, metavar=("FIRST", "COUNT"), help="flights with other seeds")
    parser.add_argument("--folder", nargs="+", type=Path, default=[], metavar="DIR", help="of further measured logs")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes")
    parser.add_argument("--out", type=Path, metavar="FILE", help="of the answers")
    parser.add_argument("--table", type=Path, metavar="FILE", help="ask nothing, print the tables of this file")
    parser.add_argument("--compare", nargs=2, type=Path, metavar=("BEFORE", "AFTER"))
    args = parser.parse_args()
    files = args.compare or ([args.table] if args.table else [])
    for path in files:
        if not path.is_file():
            parser.error(f"{path}: no such file; expected answers that a run wrote (--out)")
    cases = chosen(cases, args)
    if args.fresh:
        cases = fresh(cases, *args.fresh)
    if args.compare:
        lines, is_worse = compared(cases, *(still_asked(cases, nominals, path) for path in args.compare))
        print("\n".join(lines))
        return int(is_worse)
    path = args.out or Path("diagnosis-benchmark") / f"set-{sources_now()}.jsonl"
    rows = still_asked(cases, nominals, args.table) if args.table else run(cases, nominals, args, path)
    print("\n".join(["", *table(cases, [rows]), "", *not_right(cases, rows)]))
    return int(any(outcome(case, row) == "wrong" for case in cases for row in rows if row["case"] == case.name))


if __name__ == "__main__":
    sys.exit(main())
