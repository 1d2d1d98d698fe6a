"""The regression's first names on the labelled set, beside what each case accepts: a baseline of the diagnosis.

    python benchmarks/diagnosis_look.py [GROUP/NAME-PART ...] [--folder DIR]

A line a case: what is accepted, the share of the nominal's error left out that stays with its numbers free and with all
steps, and each step with its size, the share that it takes away and its standard errors.  `?` marks a shape that the
catalogue does not list, or that such a shape ties with.
"""

import argparse
import time
from pathlib import Path

from diagnosis_labels import read_set
from diagnosis_sources import Absent, material
from relations.look import Look, look

from launchid.diagnosis.controller.command import record
from launchid.diagnosis.controller.issued import with_commands
from launchid.log.detect import check
from launchid.log.turns import unwrapped
from launchid.diagnosis.data.used import shortened, sparser, used
from launchid.diagnosis.model.follower import NominalFollower
from launchid.log.log import Log
from sim.errors import InputError
from sim.nominal import Nominal


def looked(log: Log, nominal: Nominal) -> Look | None:
    """The look at a log, on the rows that the diagnosis fits."""
    log, _ = unwrapped(log)
    data = check(log, nominal)
    r = shortened(record(log, nominal, sparser(data, log.t, nominal)))
    return look(used(with_commands(r, NominalFollower())[0], log.t[data.usable])[0])


def words(seen: Look | None) -> str:
    """One line."""
    if seen is None:
        return "no answer"
    steps = [f"{'' if step.is_listed else '?'}{step.name} {step.number:.3g}/{step.size:.3g} "
             f"({step.share:.2f}, {step.z:.0f} s.e.)" + (f" ~ {', '.join(step.alike)}" if step.alike else "")
             for step in seen.steps]
    return f"{seen.free:.2f} {seen.left:.2f} {'; '.join(steps) or 'nothing'}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="only cases whose name holds one of these")
    parser.add_argument("--folder", type=Path, action="append", default=[], help="of measured logs")
    choice = parser.parse_args()
    cases, nominals = read_set()
    for case in cases:
        if choice.names and not any(name in case.name for name in choice.names):
            continue
        begun = time.process_time()
        try:
            there = material(case, nominals, tuple(choice.folder))
            said = words(looked(there.log, there.nominal))
        except (Absent, InputError, ValueError) as error:
            said = f"no log: {error}"
        accepted = ", ".join(map(str, case.accepted))
        print(f"{case.name} [{accepted}] {said} {time.process_time() - begun:.1f} s", flush=True)


if __name__ == "__main__":
    main()
