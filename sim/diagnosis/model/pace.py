"""How many of the grid's steps are integrated at once.

The grid is fine where stamps jitter, where a log is thinned, and for oscillations that a cause may bring; what does not
ask for it is integrated over several steps, within one command (`predictor.advance_row`).

A servo that is faster than the log resolves stands for none: it is as slow as its rows allow (`Record.fastest`), since
only where it ends counts.
"""

import numpy as np

from ...effects import actuator
from ...effects.environment import GUST, PERIODIC_DISTURBANCE
from ...effects.plant import BENDING, CONTROL_LOSS, MOMENT_STEP, SLOSH
from ...effects.table import CODE, P0, P1, Table
from ..data.record import AT_ONCE, DIRECT, FAST_SERVO, FAST_STEP, LONGEST_AT_ONCE, Record

WITHIN = 0.25           # of a row: where a late command, a loss, a moment or a gust begins within a step
OSCILLATION_STEP = 0.4  # rad a step: an amplitude is then exact to (wh)^4/120 = 2e-4


def servo_of(record: Record, table: Table, later: float, slowest: float) -> tuple[float, int]:
    """(The servo's natural frequency [rad/s] before the table's effects, steps at once).

    later  [s] that the servo answers later than the nominal's;  slowest  share of its lag that is left at least
    """
    servo = record.actuator
    own = servo.frequency / max(1.0 + later / servo.lag, slowest)
    seen, is_lag = own, False
    for row in table.actuator:
        if row[CODE] == actuator.ACTUATOR_BANDWIDTH:
            seen, lag = actuator.slowed(row[P0], row[P1], seen, servo.damping_ratio)
            is_lag = is_lag or lag > 0.0
    stands_for_none = seen >= record.fastest and not is_lag  # a lag before the servo is in proportion to it
    if stands_for_none:
        own, seen = own * record.fastest / seen, record.fastest
    if len(table.sensor) > 0:
        return own, 1  # late sensors ask for every step of the past
    if stands_for_none:
        longest = DIRECT / seen
    else:
        longest = min(LONGEST_AT_ONCE, (FAST_STEP if seen > FAST_SERVO else AT_ONCE) / seen)
    late = servo.delay + table.actuator[table.actuator[:, CODE] == actuator.ACTUATOR_DELAY, P0].sum()
    sudden = np.isin(table.plant[:, CODE], (CONTROL_LOSS, MOMENT_STEP)).any()
    if late > 0.0 or sudden or (table.environment[:, CODE] == GUST).any():
        longest = min(longest, WITHIN * record.period)
    swinging = np.concatenate([table.plant[np.isin(table.plant[:, CODE], (SLOSH, BENDING)), P1],
                               table.environment[table.environment[:, CODE] == PERIODIC_DISTURBANCE, P1]])
    if len(swinging) > 0:
        longest = min(longest, OSCILLATION_STEP / max(float(swinging.max()), 1e-9))
    return own, max(1, int(longest / record.step * (1.0 + 1e-9)))
