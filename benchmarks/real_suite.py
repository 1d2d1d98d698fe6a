"""The measured logs: is what is known of each named, does it predict better, is nothing named on shifted inputs?

    python benchmarks/real_suite.py [FOLDER] [--only NAME...] [--placebo] [--open] [--json PATH]

FOLDER: of logs (those that come with the package if left out); a log NAME.csv is judged against the nominal that
`real_known.py` has for it, or NAME.toml beside it.  For each: verdict, causes with sizes, what is known, the held-out
error over the longest horizon before and after, the remainder, seconds; and what `identify` says over the whole log.
--placebo: also with the input (beta and beta_cmd) shifted circularly by 30 to 50 % of the log, by name: no cause of
input or actuator may be named then, and k1 must be refused.  --open: leave out the logs on which nothing may be chosen.
"""

import argparse
import dataclasses
import json
import math
import sys
import time
import traceback
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from real_known import KNOWN, Known

from sim.diagnosis.report.answer import report
from sim.diagnosis.verdict import diagnose
from sim.errors import InputError, UsageError
from sim.identify import identified, log_config, report_of
from sim.log import MEASURED, Log, read_log
from sim.nominal import STANDS, load_nominal

SHIFTS = (0.3, 0.5)        # of the log, of the placebo
FAR = 3.0                  # standard deviations from what is known, at which a number is wrong
OF_INPUT = ("control_effectiveness", "control_loss", "control_slope", "thrust_misalignment", "nozzle_inertia",
            "nozzle_sensor_bias", "lateral_drift")  # besides those of actuator and controller
NAMED = ("explained", "dominant")


def moved(log: Log, name: str) -> Log:
    """The log with its input shifted circularly; by how much is drawn by the log's name."""
    rng = np.random.default_rng(zlib.crc32(name.encode()))
    rows = round(float(rng.uniform(*SHIFTS)) * len(log.t))
    return dataclasses.replace(log, beta=np.roll(log.beta, rows), beta_cmd=np.roll(log.beta_cmd, rows))


def as_command(log: Log) -> Log:
    """The input as a command instead of a measured nozzle."""
    if np.isfinite(log.beta_cmd).any():
        return log
    columns = tuple("beta_cmd" if name == "beta" else name for name in log.columns)
    return dataclasses.replace(log, columns=columns, beta=np.full(len(log.t), math.nan), beta_cmd=log.beta)


def as_input(log: Log) -> Log:
    """A command where no nozzle is measured, as identify's beta."""
    return log if np.isfinite(log.beta).any() else dataclasses.replace(log, beta=log.beta_cmd)


def logs(folder: Path, only: list[str], without_judges: bool) -> Iterator[tuple[str, Path, Known]]:
    """(name, path, what is known) of the folder's logs."""
    for path in sorted(folder.glob("*.csv")):
        name, beside = path.stem, path.with_suffix(".toml")
        known = KNOWN.get(name) or (Known(str(beside), "nothing", ()) if beside.is_file() else None)
        if known is not None and known.nominal not in STANDS and not Path(known.nominal).is_file():
            known = dataclasses.replace(known, nominal=str(beside)) if beside.is_file() else None
        if (only and name not in only) or (without_judges and known is not None and known.part == "judge"):
            continue
        if known is None:
            print(f"{name}: no nominal for it; skipped", file=sys.stderr)
            continue
        yield name, path, known


def diagnosed(log: Log, known: Known) -> dict[str, Any]:
    """The diagnose JSON and its seconds, or why there is none."""
    begun = time.perf_counter()
    try:
        result = report(diagnose(as_command(log) if known.command else log, load_nominal(known.nominal)))
    except (InputError, UsageError) as error:
        result = {"verdict": "refused", "causes": [], "gain": None, "why": str(error)}
    except Exception as error:  # one log's crash is its row's, not the suite's
        traceback.print_exc()
        result = {"verdict": "crashed", "causes": [], "gain": None, "why": repr(error)}
    return result | {"seconds": time.perf_counter() - begun}


def fitted(log: Log, known: Known) -> dict[str, Any]:
    """identify's window over the whole log without a nominal: status, a6, k1, terms, delay."""
    source = as_input(log)
    try:
        config = log_config(source, None, "all", None, False, library=known.library)
        result = report_of(identified(config, source))
    except (InputError, UsageError, ValueError) as error:
        return {"status": "refused", "why": str(error), "a6": None, "k1": None, "terms": {}, "delay": None}
    windows = result["windows"] or [{"status": "NO WINDOW", "a6": None, "k1": None, "terms": {}}]
    return {name: windows[0].get(name) for name in ("status", "a6", "a6_std", "k1", "k1_std", "terms", "fit")} \
        | {"delay": result.get("delay")}


def missed(number: float | None, std: float | None, known: tuple[float, float] | None) -> float | None:
    """Standard deviations from the known range; None: no number, or nothing known."""
    if number is None or std is None or known is None:
        return None
    return max(known[0] - number, number - known[1], 0.0) / max(std, 1e-12)


def wrong_names(result: dict[str, Any], known: Known) -> list[str]:
    """Names of causes that are not right."""
    right = {name for group in known.main for name in group} | set(known.beside)
    wrong = []
    for cause in result["causes"]:
        term = cause["parameters"].get("term", {}).get("value")
        foreign = cause["cause"] == "missing_term" and bool(known.terms) and term not in known.terms
        if known.main and (cause["cause"] not in right or foreign):
            wrong.append(cause["cause"])
    return wrong


def found(result: dict[str, Any], known: Known) -> str:
    """all, some or none of the main defect's groups named."""
    names = {name for cause in result["causes"] for name in (cause["cause"], *cause["indistinguishable_from"])}
    hit = [bool(names & set(group)) for group in known.main] if result["verdict"] in NAMED else []
    return "all" if hit and all(hit) else "some" if any(hit) else "none"


def of_input(result: dict[str, Any]) -> list[str]:
    """Named causes of input or actuator, and terms with the input: what a placebo must not have."""
    return [cause["cause"] for cause in result["causes"] if cause["where"] in ("actuator", "controller")
            or cause["cause"] in OF_INPUT or "beta" in str(cause["parameters"].get("term", {}).get("value", ""))]


def longest(gain: dict[str, Any] | None) -> tuple[str, dict[str, dict[str, float | None]]]:
    """(horizon, channels) of the longest horizon that has numbers."""
    for horizon, channels in sorted((gain or {}).get("horizons", {}).items(), key=lambda of: -float(of[0])):
        if any(each["before"] is not None for each in channels.values()):
            return horizon, channels
    return "", {}


# ---- words


def sizes(cause: dict[str, Any]) -> str:
    """A cause with its parameters."""
    said = []
    for name, of in cause["parameters"].items():
        value, std = of["value"], of["std"]
        text = value if isinstance(value, str) else "?" if value is None else f"{value:.4g}"
        said.append(f"{name} {text}" + (f" +- {std:.2g}" if std is not None else ""))
    alike = cause["indistinguishable_from"]
    return f"{cause['cause']} ({', '.join(said)}" + (f"; or {', '.join(alike)}" if alike else "") + ")"


def lines(name: str, known: Known, row: dict[str, Any]) -> list[str]:
    """What is printed of one log."""
    result, fit = row["diagnose"], row["identify"]
    horizon, channels = longest(result["gain"])
    said = [f"{name} against {Path(known.nominal).stem}" + (" [judge]" if known.part == "judge" else ""),
            f"  known      {known.words}",
            f"  verdict    {result['verdict']} in {result['seconds']:.0f} s; main defect: {row['found']}"
            + (f"; WRONG: {', '.join(row['wrong'])}" if row["wrong"] else "")]
    said += [f"  cause      {sizes(cause)}" for cause in result["causes"]]
    if result["verdict"] not in NAMED and result.get("nearest"):
        said.append("  nearest    " + ", ".join(f"{each['resembles']}" for each in result["nearest"]))
    said += [f"  held out   {horizon} s, {channel}: {of['before']:.3g} -> {of['after']:.3g}"
             for channel, of in channels.items() if of["before"] is not None and of["after"] is not None]
    remainder = result.get("remainder")
    if remainder:
        said.append(f"  remainder  {remainder['share']:.2f} at {remainder['where']}: {remainder['words']}")
    if "why" in result:
        said.append(f"  refused    {result['why']}")
    said.append("  identify   " + identify_words(fit, known, row))
    if "placebo" in row:
        placebo = row["placebo"]
        said.append(f"  placebo    {placebo['diagnose']['verdict']}: "
                    + ("; ".join(map(sizes, placebo["diagnose"]["causes"])) or "no cause")
                    + f"; of the input: {', '.join(placebo['of_input']) or 'none'}; identify "
                    + identify_words(placebo["identify"], known, {}))
    return said


def identify_words(fit: dict[str, Any], known: Known, row: dict[str, Any]) -> str:
    """One line of identify's window."""
    said = [f"{known.library}: {fit['status']}"]
    for name in ("a6", "k1"):
        if fit[name] is not None:
            off = row.get("identify_off", {}).get(name)
            said.append(f"{name} {fit[name]:.4g} +- {fit[name + '_std'] or math.nan:.2g}"
                        + (f" ({off:.1f} std off the known)" if off is not None else ""))
    said += [f"{value:.4g} {term}" for term, value in (fit["terms"] or {}).items() if term not in ("theta", "beta")]
    if fit.get("delay"):
        said.append(f"delay {fit['delay']['value']:.4g} +- {fit['delay']['std']:.2g} s")
    return ", ".join(said)


def examined(name: str, path: Path, known: Known, placebo: bool) -> dict[str, Any]:
    """Everything of one log."""
    log = read_log(path, ("t",))
    result, fit = diagnosed(log, known), fitted(log, known)
    row: dict[str, Any] = {"name": name, "known": dataclasses.asdict(known), "diagnose": result, "identify": fit,
                           "found": found(result, known), "wrong": wrong_names(result, known),
                           "identify_off": {n: missed(fit[n], fit.get(f"{n}_std"), getattr(known, n))
                                            for n in ("a6", "k1")}}
    if placebo and np.nanstd(as_input(log).beta) > 0.0:
        shifted = moved(log, name)
        other = diagnosed(shifted, known)
        row["placebo"] = {"diagnose": other, "identify": fitted(shifted, known), "of_input": of_input(other)}
    return row


def summary(rows: list[dict[str, Any]]) -> list[str]:
    """The counts that are demanded."""
    with_defect = [row for row in rows if row["known"]["main"]]
    placebos = [row["placebo"] for row in rows if "placebo" in row]
    said = [f"main defect named: all of it {sum(row['found'] == 'all' for row in with_defect)}, some "
            f"{sum(row['found'] == 'some' for row in with_defect)} of {len(with_defect)} logs (demanded: 3 of 4); "
            f"logs with a wrong name: {sum(bool(row['wrong']) for row in with_defect)} (0); "
            f"identified more than {FAR:g} std off: "
            f"{sum((off or 0.0) > FAR for row in rows for off in row['identify_off'].values())} (0); "
            f"seconds: {', '.join(format(row['diagnose']['seconds'], '.0f') for row in rows)}"]
    if placebos:
        said.append(f"placebo, {len(placebos)} logs: a cause of input or actuator named "
                    f"{sum(bool(each['of_input']) for each in placebos)} (0), k1 not refused "
                    f"{sum(each['identify']['k1'] not in (None, 0.0) for each in placebos)} (0)")
    return said


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?", default=MEASURED)
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME")
    parser.add_argument("--placebo", action="store_true")
    parser.add_argument("--open", action="store_true", help="without the logs on which nothing may be chosen")
    parser.add_argument("--json", metavar="PATH", type=Path)
    args = parser.parse_args()
    rows = []
    for name, path, known in logs(args.folder, args.only, args.open):
        rows.append(examined(name, path, known, args.placebo))
        print("\n".join(lines(name, known, rows[-1])), flush=True)
    print("\n".join(summary(rows)) if rows else f"{args.folder}: no log that is known")
    if args.json:
        args.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
