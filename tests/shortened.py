"""Nominals whose flights are short: a test takes as long as its flight."""

import dataclasses
from typing import Any

from sim.nominal import Nominal, load_nominal

AT_ONCE = {"t": (0.0, 0.5, 2.0), "theta_ref": (0.0, 0.0, -0.08)}  # guidance: the manoeuvre within the first seconds


def short(duration: float = 4.0, of: str | Nominal = "constant", **sections: Any) -> Nominal:
    """The nominal for some seconds; a dict replaces values of a section, anything else the section."""
    nominal = load_nominal(of) if isinstance(of, str) else of
    sections["simulation"] = {**sections.get("simulation", {}), "duration": duration}
    return dataclasses.replace(nominal, **{
        name: dataclasses.replace(getattr(nominal, name), **given) if isinstance(given, dict) else given
        for name, given in sections.items()})
