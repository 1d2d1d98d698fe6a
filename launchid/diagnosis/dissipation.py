"""What takes energy out of a stranger's motion is one family: damping and dry friction trade places where a log moves
little, so the nominal's are judged by the energy that all of them take along the log's own motion."""

import math

import numpy as np

from ..weakform.modes import column
from .elimination import FAMILY, Elimination, Kept, Z
from .model import Model
from .numbers import TOLERANCE_SIGMAS
from .score import covariance


def powers(m: Model) -> dict[int, float]:
    """Return number's index -> mean power that a unit of it takes along the log [rad^2/s^3 per unit of it]."""
    theta, omega, beta = m.path.motion.T
    out = {}
    for name, (term, sign) in FAMILY.items():
        if name in m.table:
            out[m.table.index(name)] = -sign * float(np.mean(omega * column(term, theta, omega, beta, m.log.t)))
    return out


def within(m: Model, el: Elimination) -> tuple[list[Kept], list[str]]:
    """Return the kept groups without those of the family that are nobody's fault, and notes on these: the nominal
    takes, within its tolerance and the error of the estimate, the energy that the fit takes."""
    per = powers(m)
    mine = [k for k in el.kept if k.group.numbers[0] in per]
    null = {j: m.log.given.get(m.table.numbers[j].name, m.table.null[j]) for j in per}
    believed = sum(power * null[j] for j, power in per.items())
    if m.log.is_flown or not mine or not believed > 0.0:
        return [*el.kept], []
    at = {j: el.final.at(j) for j in per if j in el.final.free}
    slope = np.array([per[j] for j in at])
    C = covariance(m, el.final, el.unit)[np.ix_(list(at.values()), list(at.values()))]
    more = sum(power * (el.final.p[j] - null[j]) for j, power in per.items())
    tolerance = TOLERANCE_SIGMAS * m.log.nominal.diagnosis.tolerance * believed
    if abs(more) > tolerance + Z * math.sqrt(float(slope @ C @ slope)):
        return [*el.kept], []
    names = " and ".join(k.group.name for k in mine)
    words = f"{names} differ, the energy that damping and friction take together does not (no cause)"
    return [k for k in el.kept if k not in mine], [words]
