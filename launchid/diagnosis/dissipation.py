"""What takes energy out of a stranger's motion: damping and dry friction trade places where a log moves little, so the
nominal's are judged by the energy that both take along the log's own motion, with both free."""

import numpy as np

from ..weakform.modes import column
from .hypotheses import Hypotheses, Hypothesis
from .model import Model
from .numbers import TOLERANCE_SIGMAS

FAMILY = {"damping": ("theta_dot", -1.0), "term theta_dot": ("theta_dot", 1.0),   # number: term and sign of it
          "friction": ("sign(theta_dot)", -1.0), "term sign(theta_dot)": ("sign(theta_dot)", 1.0)}


def powers(m: Model) -> dict[int, float]:
    """Return number's index -> mean power that a unit of it takes along the log [rad^2/s^3 per unit of it]."""
    theta, omega, beta = m.path.motion.T
    out = {}
    for name, (term, sign) in FAMILY.items():
        if name in m.table:
            out[m.table.index(name)] = -sign * float(np.mean(omega * column(term, theta, omega, beta, m.log.t)))
    return out


def same_energy(of: Hypotheses) -> Hypothesis | None:
    """Return the hypothesis with all of the family free if it takes, within the tolerance, the energy that the nominal
    takes: the form is nobody's fault.  None: it takes another, or the nominal takes none."""
    both = of.several([g for g in of.groups if g.name in FAMILY])
    m, per = both.m, powers(both.m)
    null = {j: m.log.given.get(m.table.numbers[j].name, m.table.null[j]) for j in per}
    believed = sum(power * null[j] for j, power in per.items())
    if not believed > 0.0:
        return None
    more = sum(power * (both.fit.p[j] - null[j]) for j, power in per.items())
    return both if abs(more) < TOLERANCE_SIGMAS * m.log.nominal.diagnosis.tolerance * believed else None
