"""The way of a flight: draw it, fly it, write its log."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from .build import STAMP_DIGITS, Build, random
from .catalogue import CAUSES, CHANCE, LISTED, UNLISTED, told
from .listed import FITS
from .motion import run
from .spec import PLAIN, Hidden, Label, Noise, Spec
from .unlisted import EFFECTS, places

COLUMNS = ("t", "theta_ref", "beta_cmd", "beta", "theta", "theta_dot")
RATES = (50.0, 100.0, 200.0)      # Hz, of the log
NOISE_RANGE = (0.67, 1.5)         # of every noise level over the declared one
DISPERSION = 0.02                 # one sigma of a6 and k1, the contract's tolerance
LARGEST_DISPERSION = 2.5          # sigmas; beyond it a deviation is no dispersion any more


def fly(spec: Spec) -> tuple[dict[str, np.ndarray], Label]:
    """(columns of the log by name, in the contract's order and units; the label).  Same spec, same bits.

    The log ends where the vehicle leaves +-0.5 rad.
    """
    build = Build(spec)
    for hidden in spec.effects:
        fit = FITS[hidden.name] if hidden.name in FITS else EFFECTS[hidden.name].fit
        fit(build, hidden)
    knobs, clock, course = build.parts()
    rows = np.zeros((-(-clock.steps // clock.log_every), len(COLUMNS)))
    written, lost = run(knobs, clock, course, rows)
    rows = rows[:written]
    rows[:, 0] = np.round(rows[:, 0], STAMP_DIGITS)
    columns = {name: rows[:, n].copy() for n, name in enumerate(COLUMNS) if name not in spec.drop}
    return columns, _label(spec, lost, float(rows[-1, 0]))


def _label(spec: Spec, lost: bool, t_end: float) -> Label:
    causes = [told(hidden) for hidden in spec.effects]
    where = [places(hidden.name, spec.drop) if cause is None else frozenset({CAUSES[cause["cause"]].place})
             for hidden, cause in zip(spec.effects, causes, strict=True)]
    unlisted = tuple(hidden.name for hidden, cause in zip(spec.effects, causes, strict=True) if cause is None)
    as_noise = len(causes) > 0 and all(cause is not None and cause["cause"] in CHANCE for cause in causes)
    return Label(tuple(cause for cause in causes if cause is not None), unlisted, tuple(where), as_noise, lost, t_end,
                 spec)


def write_csv(path: str | Path, columns: dict[str, np.ndarray], order: Iterable[str] | None = None) -> None:
    """The log as CSV: header, then a row a sample; shortest numbers that read back to the same bits.

    order  the columns to write, from left to right; None: all, as they come
    """
    names = list(columns if order is None else order)
    table = zip(*(columns[name].tolist() for name in names), strict=True)
    lines = [",".join(names), *(",".join(map(repr, row)) for row in table)]
    Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def draw_spec(seed: int, cause: str | tuple[str, ...] | None = None, nominal: str = "constant", factor: float = 1.0,
              variant: str = PLAIN, sign: float | None = None, **given: Any) -> Spec:
    """A flight drawn from `seed`.

    cause    names of LISTED or UNLISTED, one or several at once; None: nothing is wrong (a decoy)
    factor   size of each: 1 is clearly visible
    variant  `plain` or `other`, of listed causes
    sign     1.0 or -1.0, None: drawn
    given    fields of Spec that are not to be drawn (rate, noise, dispersion, reference, drop, duration, wind)

    Drawn: the log's rate, noise factors, dispersion of a6 and k1, signs, times, frequencies.  The attitude
    programme is the nominal's and no column is dropped unless given.
    """
    causes = () if cause is None else (cause,) if isinstance(cause, str) else tuple(cause)
    rng = random(seed, "spec")
    low, high = np.log(NOISE_RANGE)
    noise = Noise(*(float(factor) for factor in np.exp(rng.uniform(low, high, 5))))
    deviation = DISPERSION * np.clip(rng.standard_normal(2), -LARGEST_DISPERSION, LARGEST_DISPERSION)
    rate = float(rng.choice(RATES))
    makers = LISTED | UNLISTED
    effects: tuple[Hidden, ...] = tuple(
        makers[name](factor, random(seed, f"effect {name}"), nominal, variant, sign) for name in causes)
    drawn = Spec(nominal=nominal, seed=seed, rate=rate, effects=effects, noise=noise,
                 dispersion=(float(deviation[0]), float(deviation[1])))
    return replace(drawn, **given)
