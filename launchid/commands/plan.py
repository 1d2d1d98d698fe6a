"""Design the smallest test input that reaches an accuracy: `launchid plan`, `launchid.plan`."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..argument_checks import real
from ..cli.common import check_outputs, read_nominal
from ..cli.options import NOMINAL_HELP, add_command, given
from ..cli.terminal import answer
from ..progress import report
from ..report.answer import Answer

if TYPE_CHECKING:
    from pathlib import Path

    from sim.nominal import Nominal
    from sim.result import Columns, Figure

    from ..sources import NominalSource
    from ..test_input import Plan


def add(commands: Any) -> None:
    """Add `launchid plan` and its options to argparse's subparsers `commands`."""
    sub = add_command(commands, "plan", "design the smallest test input that reaches an accuracy",
                      "launchid plan constant --accuracy 0.01 --window 5 --out new.toml", plan)
    sub.add_argument("nominal", metavar="NOMINAL.toml", help=f"design it for {NOMINAL_HELP}")
    sub.add_argument("--accuracy", type=float, required=True, metavar="X",
                     help="reach this relative standard deviation of a6 and k1, above 0 and below 1")
    sub.add_argument("--window", type=float, required=True, metavar="S", help="set the length of a window [s]")
    sub.add_argument("--out", required=True, metavar="NEW.toml",
                     help="write the nominal with its [test_input] to this file")
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid plan` with its parsed arguments: write the nominal with its test input, and print it."""
    nominal = read_nominal(args.nominal)
    check_outputs(args.out)
    report("designing the test input")
    result = plan(nominal, **given(plan, args))
    result.write(args.out)
    answer(result.summary(args.out))


def plan(nominal: NominalSource, *, accuracy: float, window: float) -> Planned:
    """Design the smallest test input that reaches an accuracy of a6 and k1; InputError if the deflection limit forbids.

    Parameters
    ----------
    nominal : path, name of a built-in one, or Nominal
    accuracy : float
        Relative standard deviation to reach, above 0 and below 1.
    window : float
        Length of a window [s].

    Returns
    -------
    Planned
    """
    from .. import test_input
    from ..sources import load_nominal
    accuracy = real("--accuracy", accuracy, "a relative accuracy such as 0.01")
    designed = test_input.plan(load_nominal(nominal), accuracy, real("--window", window, "a number of seconds"))
    multisine = designed.nominal.test_input
    names = ("start", "duration", "frequency", "amplitude", "phase")
    return Planned(designed, window, {
        "before": designed.before, "after": designed.after, "rms": designed.root_mean_square, "peak": designed.peak,
        "test_input": None if multisine is None else {name: getattr(multisine, name) for name in names}})


@dataclass(frozen=True, eq=False)
class Planned(Answer):
    """Result of `plan`: a test input, and the accuracy of a6 and k1 without and with it."""

    plan: Plan
    window: float
    report: dict[str, Any]
    warnings: tuple[str, ...] = ()

    @property
    def nominal(self) -> Nominal:
        """The nominal with the designed [test_input], without one if none is needed."""
        return self.plan.nominal

    def summary(self, of: str = "test input") -> str:
        plan, multisine = self.plan, self.plan.nominal.test_input
        head = (f"smallest possible standard deviation (Cramer-Rao bound) of the less certain of a6 and k1, median of "
                f"{self.window:g} s windows: {100 * plan.before:.3g} % without a test input, {100 * plan.after:.3g} % "
                "with it")
        if multisine is None:
            return f"{head}\n{of}: no test input needed"
        sines = ", ".join(f"{a:.3g} rad at {f:.3g} rad/s"
                          for a, f in zip(multisine.amplitude, multisine.frequency, strict=True))
        return f"{head}\n{of}: test input of {sines}; {plan.root_mean_square:.2e} rad rms, peak {plan.peak:.2e} rad"

    def columns(self) -> Columns:
        names, multisine = ("frequency", "amplitude", "phase"), self.plan.nominal.test_input
        return {name: [] if multisine is None else list(getattr(multisine, name)) for name in names}

    def _figure(self) -> Figure:
        from ..report.flight_figures import plan_figure
        return plan_figure(self.plan)

    def write(self, path: str | Path) -> None:
        """Write the nominal as TOML: the file that it came from, with its new [test_input]."""
        from sim.nominal import rewrite_nominal
        rewrite_nominal(self.nominal, path)
