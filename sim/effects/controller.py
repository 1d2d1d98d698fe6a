"""Effects in the controller: the logged command is not the nominal controller's.

`delay` is computing time.  The command is issued once a period and held, so what
is issued (and logged) is the mean over the period of the command computed `delay`
earlier: a whole number of periods shifts it, a part of one mixes two neighbours.
Before the first the command was 0.

To add an effect: its row in CONTROLLER_EFFECTS, its branch in `change`.
"""

from collections.abc import Mapping

from .actuator import LONGEST_DELAY
from .table import Cause, Changes, Parameter

CONTROLLER_EFFECTS = (
    Cause("controller_mismatch", "controller", (
        Parameter("kp_scale", "", neutral=1.0),
        Parameter("kd_scale", "", neutral=1.0),
        Parameter("delay", "s", neutral=0.0, low=0.0, high=LONGEST_DELAY))),
)


def change(of: Changes, name: str, p: Mapping[str, float]) -> None:
    """Add the effect of this name, with these values, to what the flight's effects change."""
    match name:
        case "controller_mismatch":  # gains on board that are not those of the simulation
            of.kp_scale *= p["kp_scale"]
            of.kd_scale *= p["kd_scale"]
            of.computing_time += p["delay"]
