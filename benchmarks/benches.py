"""What identify says of bodies that no nominal flew, whose truth is known.

    python benchmarks/benches.py [--half tuning|held-out ...]

The bodies are those of benchmarks/strangers.py: drone, propeller bench, servo, balancing robot, pendulum, stand, with
disturbances that no model has and a late input; nominals are right, or one thing is wrong. Per kind: logs, logs with an
OK window, windows that are OK, and those of them whose 95 % interval, 2 % of the number added, misses the truth in beta
or in the term of theta.
"""

import argparse
import math
import os
from collections import Counter, defaultdict

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from strangers import HALVES, WRONG, cases, drawn, made

from launchid.commands.identify import identify

TOLERANCE = 0.02   # of a number: the stand's drag is of the second order


def counted(kind: str, wrong: str, seed: int) -> Counter[str]:
    """Identify one log; return its counts."""
    body = drawn(kind, np.random.default_rng(seed))
    truth = {"beta": body.k, "sin(theta)": -body.g, "theta": body.a6}
    log, nominal = made(kind, wrong, seed)
    windows = identify(log, nominal).report["windows"]
    valid = [w for w in windows if w["valid"]]
    missed = sum(any(abs(value - truth[term]) > 1.96 * math.hypot(w["terms_std"][term], TOLERANCE * truth[term])
                     for term, value in w["terms"].items() if truth.get(term) and w["terms_std"].get(term))
                 for w in valid)
    return Counter(logs=1, told=bool(valid), windows=len(windows), OK=len(valid), missed=missed)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--half", nargs="*", choices=tuple(HALVES), default=list(HALVES))
    counts = defaultdict[str, Counter[str]](Counter)
    for half in parser.parse_args().half:
        for _, kind, wrong, seed in cases(half):
            of_log = counted(kind, wrong, seed)
            counts[kind] += of_log
            counts["all"] += of_log
    for kind in (*WRONG, "all"):
        print(f"{kind:10s}", *(f"{name} {counts[kind][name]:4d}" for name in (
            "logs", "told", "windows", "OK", "missed")))


if __name__ == "__main__":
    main()
