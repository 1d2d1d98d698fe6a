"""The answers of `update` to a sample, and the statuses of a window's estimate."""

from enum import IntEnum


class Status(IntEnum):
    """Answer of `Estimator.update`: >= 0 the sample was used, < 0 it changed nothing but a counter."""

    ACCEPTED = 0
    WINDOW_COMPLETE = 1  # a new estimate is ready
    AFTER_GAP = 2        # first sample of a new segment: more than `max_gap` after the last one
    CLOCK_RESET = 3      # first sample of a new segment and a new window: the clock was set back
    RECOVERED = 4        # first sample of all again: the estimator's own memory was damaged, everything was forgotten
    NONFINITE = -1       # t, theta or beta not finite, or an infinity anywhere
    RANGE = -2           # a value beyond the range of its channel
    DT_ZERO = -3         # the time stamp of the last accepted sample again
    DT_NEGATIVE = -4     # earlier than the last accepted sample
    BUSY = -5            # `update` was called while an update was running


class EstimateStatus(IntEnum):
    """The reason why an estimate is valid or not."""

    OK = 0
    SHORT = 1            # too few usable rows in the window
    GAP = 2              # too few usable rows, and the window has a gap
    RANK = 3             # the terms cannot be told apart on this window
    LOW_INFORMATION = 4  # noise leaves nothing that can be known
    SATURATED = 5        # too few rows off the sensors' end stops
    NUMERICS = 6         # a result that is not finite
    MODEL = 7            # the innovations contradict the model: numbers would lie
    SEPARATION = 8       # a6 and k1 cannot be told apart: only a combination is known
    STUCK = 9            # a sensor stood still while what it measures moved
    UNCHECKED = 10       # of logs, never in flight: what the numbers rest on could not be tested
