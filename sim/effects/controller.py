"""Effects in the controller: the logged command is not the nominal controller's.

`delay` is computing time.  The command is issued once a period and held, so what
is issued (and logged) is the mean over the period of the command computed `delay`
earlier: a whole number of periods shifts it, a part of one mixes two neighbours.
Before the first the command was 0.

To add an effect: its kernel, its branch below, its row in EFFECTS.
"""

from ..vehicle.kernels import asked, kernel
from .actuator import LONGEST_DELAY
from .table import CODE, P0, P1, P2, Cause, Parameter

CONTROLLER_MISMATCH = 0

EFFECTS = (
    Cause("controller_mismatch", "controller", (
        Parameter("kp_scale", "", neutral=1.0),
        Parameter("kd_scale", "", neutral=1.0),
        Parameter("delay", "s", neutral=0.0, low=0.0, high=LONGEST_DELAY))),
)


# ---- the physics


@kernel
def mismatched_gains(kp_scale, kd_scale, kp, kd):
    """(kp_scale kp, kd_scale kd [s]): the gains on board are not those of the simulation."""
    return kp_scale * kp, kd_scale * kd


# ---- the place: fx (n, N_COLUMNS) inout, its rows of the table


@asked
def gains(fx, kp, kd):
    """The gains on board of the nominal's kp and kd [s]."""
    for e in range(fx.shape[0]):
        if fx[e, CODE] == CONTROLLER_MISMATCH:
            kp, kd = mismatched_gains(fx[e, P0], fx[e, P1], kp, kd)
    return kp, kd


@asked
def latency(fx):
    """Computing time [s] between measuring and issuing."""
    delay = 0.0
    for e in range(fx.shape[0]):
        if fx[e, CODE] == CONTROLLER_MISMATCH:
            delay += fx[e, P2]
    return delay
