"""Replay vectors: short flights with what the estimator answered to each sample, committed.

    python tests/replay/make.py            answer the committed samples anew and write what changed
    python tests/replay/make.py --inputs   fly anew as well

One CSV a vector: a row a sample, its seven fields and the status; where a window closed, what left the estimator too.
Numbers are the shortest that read back to the same bits.  A change of behaviour is a difference in these files.
"""

import argparse
import csv
import dataclasses
import itertools
import math
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
if __name__ == "__main__":
    sys.path.insert(0, str(FOLDER.parents[1]))

from launchid.robustness.level import ranged_model  # noqa: E402
from launchid_core import Change, Config, Estimate, Estimator, Sample, Status  # noqa: E402
from sim.effects import from_text  # noqa: E402
from sim.flight import fly  # noqa: E402
from sim.nominal import load_nominal  # noqa: E402
from sim.onboard import onboard_model  # noqa: E402
from sim.sections import Offsets, Wind  # noqa: E402

DECIMALS = 9    # of a sample's fields: far below any sensor's noise, and rows that a reader can take in
NAN, INF = math.nan, math.inf
WINDY_OFFSETS = Offsets(thrust_misalignment=0.004, attitude_bias=0.005, gyro_bias=1e-3, nozzle_sensor_bias=1e-3,
                        moment=1e-3)
DRIFTING = load_nominal("constant")  # by its range in the flight
CALM = dataclasses.replace(DRIFTING, a6_drift=0.0, k1_drift=0.0)
WINDY = dataclasses.replace(CALM, wind=Wind(walk=0.005, turbulence=0.005), offsets=WINDY_OFFSETS)
RANGED = dataclasses.replace(load_nominal("vega_like"), a6_drift=0.0, k1_drift=0.0)

NUMBERS = ("a6", "k1", "a6_std", "k1_std", "a6_k1_corr", "a6_dot", "k1_dot", "a6_bound", "k1_bound", "condition",
           "whiteness", "wind", "wind_std")
TRACKED = ("valid", "a6", "k1", "a6_std", "k1_std", "a6_k1_corr")
LEVEL = ("delta", "delta_std", "band", "in_range", "out_since")
CHANGE = ("t", "t_std", "parameter", "before", "after", "size", "size_std", "alarm", "final")


@dataclasses.dataclass(frozen=True)
class Vector:
    """A flight and who is to identify it."""

    config: Config
    samples: Callable[[], Iterable[Sample]]


def flown(nominal, seconds: float, *effects: str, suite: str = "flight") -> Callable[[], Iterator[Sample]]:
    rows = round(seconds / 0.01)
    return lambda: itertools.islice(fly(nominal, seed=5, suite=suite, effects=[from_text(text) for text in effects],
                                        period=0.01), rows)


def faulty() -> Iterator[Sample]:
    """A flight with what a log may do, at row numbers that a reader can find again."""
    wrong = {50: {"theta": NAN}, 51: {"beta": INF}, 60: {"theta_dot": NAN}, 61: {"theta_dot": -INF},
             70: {"theta": 150.0}, 80: {"theta_dot": 1e308}, 90: {"theta": 0.3}, 95: {"beta_cmd": NAN},
             130: {"t": NAN}, 131: {"t": 1e11}, 140: {"theta_dot": 5e-324},
             240: {"beta": 1.0}, 241: {"beta": 1.0}, 242: {"beta": 1.0}}
    stuck = 0.0
    for k, sample in enumerate(flown(CALM, 6.0)()):
        if 160 <= k < 190:
            continue  # a gap
        if k == 300:
            stuck = sample.theta_dot
        changed = {"theta_dot": stuck} if 300 <= k < 330 else {}
        late = 10.0 if k >= 450 else 0.0  # the clock is set back
        back = {100: 0.02, 110: 0.01}.get(k, 0.0)
        yield sample._replace(**{"t": sample.t - late - back} | changed | wrong.get(k, {}))


def config(formulation: str = "filtered", **choices) -> Config:
    return Config(**{"window": 0.5, "sample_period": 0.01, "formulation": formulation} | choices)


VECTORS = {
    "integral": Vector(config("integral"), flown(CALM, 3.0)),
    "measured-ten-terms": Vector(config("measured", library="quadratic", compression=2, seed=3),
                                 flown(CALM, 2.0, suite="ideal")),
    "integral-faults": Vector(config("integral"), faulty),
    "filtered": Vector(config(model=ranged_model(RANGED)), flown(RANGED, 7.5, "control_loss:fraction=0.6,time=5")),
    "filtered-faults": Vector(config(model=onboard_model(CALM)), faulty),
    "wind": Vector(config(model=onboard_model(WINDY)), flown(WINDY, 3.0)),
    "drift": Vector(config(model=onboard_model(DRIFTING)), flown(DRIFTING, 3.0, "control_loss:fraction=0.4,time=2")),
}


def cell(value: object) -> str:
    """A number as the shortest text of its bits; anything else by its name."""
    if value is None:
        return ""
    return repr(float(value)) if isinstance(value, float) else str(value)


def window_cells(estimate: Estimate, changes: tuple[Change, ...], counts: dict[str, int]) -> dict[str, str]:
    """The cells that leave with a window."""
    said: dict[str, object] = {"estimate": estimate.status.name, "rows": estimate.rows, "gaps": estimate.gaps}
    said |= {name: getattr(estimate, name) for name in NUMBERS}
    said |= {f"{term} in theta_ddot": x for term, x in zip(estimate.terms, estimate.xi[:, 1].tolist(), strict=True)}
    if estimate.tracked is not None:
        said |= {f"tracked {name}": getattr(estimate.tracked, name) for name in TRACKED}
    if estimate.uncertainty is not None:
        for parameter in ("a6", "k1"):
            level = getattr(estimate.uncertainty, parameter)
            said |= {f"level {parameter} {name}": getattr(level, name) for name in LEVEL}
    for name, offset in estimate.offsets.items():
        said |= {name: offset.value, f"{name} std": offset.std}
    last = changes[-1] if changes else None
    said |= {"changes": len(changes)} | {f"change {name}": getattr(last, name, "") for name in CHANGE}
    said |= {name: n for name, n in counts.items() if name not in Status.__members__}
    return {name: cell(value) for name, value in said.items()}


def answers(vector: Vector, samples: Iterable[Sample]) -> list[dict[str, str]]:
    """The rows of a vector's file."""
    estimator, rows = Estimator(vector.config), []
    for sample in samples:
        status = estimator.update(sample)
        row = {name: cell(value) for name, value in zip(Sample._fields, sample, strict=True)} | {"status": status.name}
        if status is Status.WINDOW_COMPLETE:
            row |= window_cells(estimator.estimate(), estimator.changes(), estimator.counts)
        rows.append(row)
    return rows


def read(name: str) -> list[dict[str, str]]:
    """A committed vector's rows, cells that are empty left out."""
    with (FOLDER / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        return [{column: text for column, text in row.items() if text} for row in csv.DictReader(file, strict=True)]


def samples_of(rows: list[dict[str, str]]) -> list[Sample]:
    return [Sample(*(float(row[name]) for name in Sample._fields)) for row in rows]


def write(name: str, rows: list[dict[str, str]]) -> None:
    columns = list(dict.fromkeys(itertools.chain.from_iterable(rows)))
    with (FOLDER / f"{name}.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", action="store_true")
    args = parser.parse_args()
    for name, vector in VECTORS.items():
        if args.inputs:
            samples = [Sample(*(round(x, DECIMALS) if math.isfinite(x) and abs(x) > 1e-300 else x for x in sample))
                       for sample in vector.samples()]
        else:
            samples = samples_of(read(name))
        write(name, answers(vector, samples))


if __name__ == "__main__":
    main()
