"""The answers of `identify` over each measured log, without a nominal, and where its input is of another time.

    python benchmarks/real_suite.py [--only NAME...] [--folder DIR...] [--judge] [--placebo]

The logs are those of the labelled set (`diagnosis_set.toml`, groups measured and placebo; what `diagnose` says of them:
`diagnosis_set.py --kinds measured placebo`); those that may not be passed on lie in a --folder (`real_fetched.py`).
One window over the whole log: status, a6, k1, how far they are from what is known, the delay.  --placebo: also of the
logs with their input shifted; k1 must be refused there.  --judge: also those on which nothing may be chosen.
"""

import argparse
import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
from diagnosis_labels import FAR, Case, read_set
from diagnosis_sources import Absent, material

from launchid.identification.windows import identified, log_config, report_of
from launchid.log.log import Log
from sim.errors import InputError, UsageError

NUMBERS = ("a6", "k1")


def fitted(log: Log, library: str) -> dict[str, Any]:
    """identify's window over the whole log without a nominal: status, a6, k1, terms, delay."""
    try:
        config = log_config(log, None, "all", None, False, library=library)
        result = report_of(identified(config, log))
    except (InputError, UsageError, ValueError) as error:
        return {"status": "refused", "why": str(error), "a6": None, "k1": None, "terms": {}, "delay": None}
    windows = result["windows"] or [{"status": "NO WINDOW", "a6": None, "k1": None, "terms": {}}]
    return {name: windows[0].get(name) for name in ("status", "a6", "a6_std", "k1", "k1_std", "terms", "fit")} \
        | {"delay": result.get("delay")}


def missed(number: float | None, std: float | None, known: list[float] | None) -> float | None:
    """Standard deviations from the known range; None: no number, or nothing known."""
    if number is None or std is None or known is None:
        return None
    return max(known[0] - number, number - known[1], 0.0) / max(std, 1e-12)


def line(name: str, fit: dict[str, Any], off: dict[str, float | None]) -> str:
    """The line printed of one log."""
    said = [f"{name}: {fit['status']}"]
    for number in NUMBERS:
        if fit[number] is not None:
            said.append(f"{number} {fit[number]:.4g} +- {fit[number + '_std'] or math.nan:.2g}"
                        + (f" ({off[number]:.1f} std off the known)" if off[number] is not None else ""))
    said += [f"{value:.4g} {term}" for term, value in (fit["terms"] or {}).items() if term not in ("theta", "beta")]
    if fit.get("delay"):
        said.append(f"delay {fit['delay']['value']:.4g} +- {fit['delay']['std']:.2g} s")
    return ", ".join([*said, fit.get("why", "")]).removesuffix(", ")


def chosen(cases: list[Case], args: argparse.Namespace) -> list[Case]:
    """The measured logs that are asked for, then their placebos."""
    kinds = ("measured", "placebo") if args.placebo else ("measured",)
    return [case for kind in kinds for case in cases if case.kind == kind and case.source[0] == "log"
            and (args.judge or case.part != "judge") and (not args.only or case.source[1] in args.only)]


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME")
    parser.add_argument("--folder", nargs="+", type=Path, default=[], metavar="DIR")
    parser.add_argument("--judge", action="store_true", help="also the logs on which nothing may be chosen")
    parser.add_argument("--placebo", action="store_true")
    args = parser.parse_args()
    cases, nominals = read_set()
    known = {case.source[1]: case.identify for case in cases if case.kind == "measured"}
    far = kept = 0
    for case in chosen(cases, args):
        asked = known[case.source[1]]
        plain = {key: value for key, value in case.options.items() if key != "as_command"}
        try:
            log = material(dataclasses.replace(case, options=plain), nominals, tuple(args.folder)).log
        except Absent as absent:
            print(f"{case.name}: skipped: {absent}")
            continue
        moves = log if np.isfinite(log.beta).any() else dataclasses.replace(log, beta=log.beta_cmd)
        fit = fitted(moves, asked.get("library", "rigid-body"))
        off = {name: missed(fit[name], fit.get(f"{name}_std"), asked.get(name)) for name in NUMBERS}
        far += case.kind == "measured" and any((each or 0.0) > FAR for each in off.values())
        kept += case.kind == "placebo" and fit["k1"] not in (None, 0.0)
        print(line(case.name, fit, off), flush=True)
    print(f"identified more than {FAR:g} std off: {far} (0); placebos whose k1 is not refused: {kept} (0)")


if __name__ == "__main__":
    main()
