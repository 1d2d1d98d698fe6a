"""Write the estimator in C: `launchid export-c`, `launchid.export_c`."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sim.errors import UsageError

from ..argument_checks import DEFAULT_WINDOW
from ..cli.common import check_outputs, read_nominal
from ..cli.options import NOMINAL_HELP, add_choices, add_command, given
from ..cli.terminal import say
from ..progress import report
from ..report.answer import Answer

if TYPE_CHECKING:
    from launchid_core import Config, Sample
    from sim.result import Columns, Figure

    from ..sources import NominalSource


def add(commands: Any) -> None:
    """Add `launchid export-c` and its options to argparse's subparsers `commands`."""
    sub = add_command(commands, "export-c", "write the estimator in C99, bit for bit equal to the Python version",
                      "launchid export-c constant --out port --window 5", export_c)
    sub.add_argument("nominal", metavar="NOMINAL.toml", help=f"export the estimator of {NOMINAL_HELP}")
    sub.add_argument("--out", required=True, metavar="DIR",
                     help="write launchid.c, launchid.h, replay vectors, README.md and the rest into this folder")
    sub.add_argument("--window", type=float, metavar="S",
                     help="set the length of a window [s] (default %(default)s)")
    sub.add_argument("--period", type=float, metavar="S", help="set the time between samples [s] (default: "
                                                                         "the nominal's)")
    add_choices(sub)
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid export-c` with its parsed arguments: write the C files into the folder --out."""
    nominal = read_nominal(args.nominal)
    check_outputs(folder=args.out)
    report("writing the estimator in C, and flying its vectors")
    result = export_c(nominal, **given(export_c, args))
    replaced = " (what was there of these files is replaced)" if (Path(args.out) / "launchid.c").exists() else ""
    result.write(args.out)
    say(result.summary(args.out) + replaced)


def export_c(nominal: NominalSource, *, window: float = DEFAULT_WINDOW, period: float | None = None,
             formulation: str | None = None, library: str = "rigid-body", solver: str = "stls",
             threshold: float | None = None, compression: int = 1, seed: int = 0, noise: str = "estimated",
             **further: Any) -> Exported:
    """Write the estimator in C, bit for bit equal to the Python version.

    Parameters
    ----------
    nominal : path, name of a built-in one, or Nominal
    window : float
        Length of a window [s].
    period : float, optional
        Time between samples [s]; None: the nominal's.
    formulation : str, optional
        As of `identify`; None: "filtered".
    library, solver, threshold, compression, seed, noise
        As of `identify`.
    **further
        Fields of `launchid_core.Config`.

    Returns
    -------
    Exported
        Its `write` writes the files.
    """
    from launchid_core import Config
    from sim.onboard import onboard_model

    from ..c_export.kit import exported
    from ..c_export.vectors import flown
    from ..robustness import level
    from ..sources import load_nominal
    nominal = load_nominal(nominal)
    formulation = formulation or "filtered"
    model = None
    if formulation == "filtered":
        model = level.ranged_model(nominal) if nominal.uncertainty is not None else onboard_model(nominal)
    try:
        config = Config(window=window, sample_period=nominal.sensors.period if period is None else period,
                        formulation=formulation, model=model, library=library, solver=solver, threshold=threshold,
                        compression=compression, seed=seed, noise=noise, **further)
    except ValueError as error:
        raise UsageError(str(error)) from None
    except TypeError as error:  # of Python's: a word that is none of Config's
        raise UsageError(f"export-c: {str(error).removeprefix('Config.__init__() ')}") from None
    flights = flown(nominal, config)
    files = exported(config, flights)
    return Exported(files, config, flights[0], {"files": list(files)})


@dataclass(frozen=True, eq=False)
class Exported(Answer):
    """Result of `export_c`: file name -> text of the C files, the configuration, samples of a flight to check it."""

    files: dict[str, str]
    config: Config
    samples: list[Sample]   # of the first flight that it is checked with
    report: dict[str, Any]
    warnings: tuple[str, ...] = ()

    def summary(self, of: str = "C files") -> str:
        proof = "; make check" if "check.c" in self.files else ""
        return f"{of}: {', '.join(self.files)}; cc -std=c99 -O2 -ffp-contract=off launchid.c{proof}"

    def columns(self) -> Columns:
        return {"file": list(self.files), "lines": [text.count("\n") for text in self.files.values()]}

    def _figure(self) -> Figure:
        import numpy as np

        from launchid_core import Sample

        from ..log.log import log_of
        columns = dict(zip(Sample._fields, np.array(self.samples).T, strict=True))
        known = {name: x for name, x in columns.items() if np.isfinite(x).any()}
        return log_of(known, "vectors.h")._figure()

    def write(self, folder: str | Path) -> None:
        """Write the files into a folder, which is made if there is none."""
        from sim.files import make_folder, write_text
        place = make_folder(folder)
        for name, text in self.files.items():
            write_text(place / name, [text])
