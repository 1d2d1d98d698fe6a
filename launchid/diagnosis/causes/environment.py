"""Causes around the vehicle."""

from ..data.record import Record
from .hypothesis import Free, Hypothesis, Start, Values, as_aside, size
from .plant import ANOTHER_PROFILE

ABEAM = 1.0             # rad: what comes from farther aside is no wind on a vehicle that flies
GUST_DURATION = 4.0     # s, for which the limit is given
REFERENCE = "an independent attitude reference, or air data"


def _gust(record: Record) -> Values:
    middle = float(0.5 * (record.t[0] + record.t[-1]))
    return (middle - 0.5 * GUST_DURATION, GUST_DURATION)


# Chance, not a function of time: found by what the innovations are like, not by a search along a deterministic model.
TURBULENCE = Hypothesis("turbulence", (size("level", 1e-3, 0.0),
                                       Free("time_constant", 0.1, 0.05, 20.0, logarithmic=True)), 0.0,  # s
                        "the air is turbulent: {level} of wind angle that changes within {time_constant}")
WIND_WALK = Hypothesis("wind_walk", (size("level", 1e-3, 0.0),), 0.0, "the wind wanders by {level}")

CAUSES = (
    Hypothesis("gust", (size("angle", 1e-3, -ABEAM, ABEAM), Free("time", 0.05),
                        Free("duration", 0.02, 0.2, 20.0, logarithmic=True)), 0.0,  # s: longer, the wind has changed
               "a gust of {angle} hits at {time} for {duration}", start=Start.PULSE, limit_at=_gust, may_repeat=True,
               held=as_aside),
    Hypothesis("steady_wind", (size("angle", 1e-3, -ABEAM, ABEAM),), 0.0,
               "a steady wind adds {angle} to the angle of attack",
               decides=(("attitude_bias", REFERENCE), ("thrust_misalignment", ANOTHER_PROFILE)), held=as_aside),
    Hypothesis("periodic_disturbance", (
        size("amplitude", 1e-4),
        Free("frequency", 1e-4, 0.05, 300.0, logarithmic=True),  # its phase drifts over the whole log
        Free("phase", 0.02)), 0.0,
        "a moment of {amplitude} oscillates at {frequency}",
        start=Start.LINE, limit_at=lambda record: (5.0, 0.0), may_repeat=True),
)
