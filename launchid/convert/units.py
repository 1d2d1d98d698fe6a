"""The units of time and angle that a map may name."""

import math

TIME_UNITS = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}   # so many in a second
ANGLE_UNITS = {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180.0}   # [rad]
