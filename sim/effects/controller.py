"""Effects in the controller: the logged command is not the nominal controller's.

`delay` is computing time.  The command is issued once a period and held, so what
is issued (and logged) is the mean over the period of the command computed `delay`
earlier: a whole number of periods shifts it, a part of one mixes two neighbours.
Before the first the command was 0.

To add an effect: its row in CONTROLLER_EFFECTS.
"""

from .actuator import LONGEST_DELAY
from .table import Cause, Parameter

CONTROLLER_EFFECTS = (
    Cause("controller_mismatch", "controller", (
        Parameter("kp_scale", "", neutral=1.0, into="kp_scale"),  # gains on board that are not those of the simulation
        Parameter("kd_scale", "", neutral=1.0, into="kd_scale"),
        Parameter("delay", "s", neutral=0.0, low=0.0, high=LONGEST_DELAY, into="computing_time")),
        "the logged command is not the nominal controller's"),
)
