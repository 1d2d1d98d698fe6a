"""A foreign launcher as judge, JSBSim's J246: are hidden faults named, how large, is a true nominal consistent?

    python benchmarks/j246.py [--cases NAME...] [--seeds FIRST COUNT]

Needs the `jsbsim` package (extra `judges`); flights, faults and nominals are those of `tests/foreign`, and answers are
judged as those of the labelled set.  Cases: six kinds if left out (weak_gimbal, k1_wrong, gust, slow_servo, gyro_bias,
engine_out) and calm; `all`: every one.  Seeds below 1000 are for building, from 1000 on for judging: choose nothing on
them.  A size's error is relative to its distance from neutral (a scale's from 1).
"""

import argparse

import numpy as np
from diagnosis_labels import OTHERS, Case, outcome, said, sizes
from diagnosis_set import answered, warmed
from flights import Table
from foreign import j246_cases


def case_of(name: str, seed: int) -> Case:
    """Return the labelled case of a flight."""
    known, _ = j246_cases.flown(name, seed)
    return Case(f"{name} {seed}", name, "foreign", ("foreign", name), "", ("/".join(known.causes) or "consistent",),
                {"seed": seed}, known.look_alikes, (OTHERS,))


def main() -> None:
    """Run and print: a line a flight, a line a case."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", nargs="+", default=[*j246_cases.SIX, "calm"], choices=[*j246_cases.CASES, "all"],
                        metavar="NAME")
    parser.add_argument("--seeds", nargs=2, type=int, default=(0, 1), metavar=("FIRST", "COUNT"))
    args = parser.parse_args()
    warmed()
    rows: list[tuple[str, str, float, list[float]]] = []
    for name in j246_cases.CASES if "all" in args.cases else args.cases:
        for seed in range(args.seeds[0], sum(args.seeds)):
            case = case_of(name, seed)
            row = answered(case, {}, (), "")
            errors = [off / abs(row["truth"][key] - key.endswith("scale")) for key, off, _ in sizes(case, row)]
            rows.append((name, outcome(case, row), row["seconds"], errors))
            print(f"{case.name:22} {rows[-1][1]:7} {row['seconds']:5.0f} s  {said(row)}  errors "
                  f"{errors} of {row['truth']}", flush=True)
    table = Table("case 16", "flights 7d", "right 6d", "wrong 6d", "refused 6d", "size error (median) 6.1%",
                  "seconds (median) 6.1f")
    for name in (*dict.fromkeys(name for name, *_ in rows), "all"):
        made = [each for each in rows if name in (each[0], "all")]
        counts = [sum(each[1] == wanted for each in made) for wanted in ("right", "wrong", "refused")]
        errors = [error for *_, of in made for error in of]
        table.row(name, len(made), *counts, np.median(errors) if errors else np.nan,
                  np.median([each[2] for each in made]))


if __name__ == "__main__":
    main()
