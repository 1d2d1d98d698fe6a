"""The cause in the controller: the command tells it exactly (`controller.check`), so no search looks for it."""

from .hypothesis import Hypothesis, size

MISMATCH = Hypothesis("controller_mismatch", (size("kp_scale", 0.01), size("kd_scale", 0.01), size("delay", 0.01)), 1.0,
                      "the controller on board is not the nominal's: kp times {kp_scale}, kd times {kd_scale}, "
                      "computing time {delay}",
                      corrections=())  # the command is logged as it was issued
