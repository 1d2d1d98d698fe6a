"""Attitude programmes unlike the nominal's: steps, ramps and doublets in random order."""

import numpy as np

LARGEST = 0.14        # rad: never beyond, whatever the vehicle's own programme reaches
QUIET_START = 2.0     # s before anything moves
RISE = 0.5            # s that a step takes; a faster one would only drive the command into its limit
STEP = 0.2            # of the bound, largest step or doublet
RATE = 0.02           # rad/s, fastest ramp


def rough_programme(rng: np.random.Generator, duration: float, amplitude: float) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (t [s], angle [rad]) up to `duration`, within +-min(1.1 amplitude, LARGEST)."""
    bound = min(1.1 * amplitude, LARGEST)
    t, angle = [0.0, QUIET_START], [0.0, 0.0]

    def go(to: float, over: float) -> None:
        t.append(t[-1] + over)
        angle.append(float(np.clip(to, -bound, bound)))

    while t[-1] < duration:
        kind, here = rng.integers(3), angle[-1]
        jump = float(rng.uniform(0.3, 1.0) * STEP * bound) * (1.0 if rng.random() < 0.5 else -1.0)
        if kind == 0:
            go(here + jump, RISE)
        elif kind == 1:
            goal = float(rng.uniform(-bound, bound))
            go(goal, abs(goal - here) / (RATE * float(rng.uniform(0.3, 1.0))) + RISE)
        else:
            half = float(rng.uniform(0.5, 2.0))
            for to in (here + jump, here + jump, here - jump, here - jump, here):
                go(to, RISE if to != angle[-1] else half)
        go(angle[-1], float(rng.uniform(0.5, 5.0)))
    return np.array(t), np.array(angle)
