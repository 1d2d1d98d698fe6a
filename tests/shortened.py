"""Nominals whose flights are short: a test takes as long as its flight."""

import dataclasses
from typing import Any

from sim.nominal import Nominal, Offsets, Wind, load_nominal

AT_ONCE = {"t": (0.0, 0.5, 2.0), "theta_ref": (0.0, 0.0, -0.08)}  # guidance: the manoeuvre within the first seconds

CALM = load_nominal("constant")
WINDY = dataclasses.replace(
    CALM, wind=Wind(walk=0.005, turbulence=0.005),
    offsets=Offsets(thrust_misalignment=0.004, attitude_bias=0.005, gyro_bias=1e-3, nozzle_sensor_bias=1e-3,
                    moment=1e-3))


def short(duration: float = 4.0, of: str | Nominal = "constant", **sections: Any) -> Nominal:
    """The nominal for some seconds; a dict replaces values of a section, anything else the section."""
    nominal = load_nominal(of) if isinstance(of, str) else of
    sections["simulation"] = {**sections.get("simulation", {}), "duration": duration}
    return dataclasses.replace(nominal, **{
        name: dataclasses.replace(getattr(nominal, name), **given) if isinstance(given, dict) else given
        for name, given in sections.items()})
