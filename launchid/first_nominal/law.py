"""Say the controller that a log shows in the words of a nominal's [controller]."""

from dataclasses import dataclass

from sim.nominal import Controller

from ..controller.fit import FittedLaw, answered, fit_law
from ..log.log import Log

OF_INTEGRAL = 1e-6   # a memory of the command so near to 1 is an integral's


@dataclass(frozen=True)
class ShownLaw:
    """A controller that a log shows, and the standard deviations of its gains."""

    controller: Controller
    kp_std: float
    kd_std: float


def shown_law(log: Log) -> ShownLaw | None:
    """Return the controller of a log; None if its commands show none, or one that no [controller] says."""
    ticks = answered(log)
    fitted = ticks if isinstance(ticks, str) else fit_law(ticks)
    if isinstance(fitted, str):
        return None
    made, std = said(fitted), fitted.gains_std
    return None if made is None else ShownLaw(made, std["kp"], std.get("ki" if made.is_rate_law else "kd", 0.0))


def said(fitted: FittedLaw) -> Controller | None:
    """Return a law as a nominal says it: PD on attitude and gyro, PD with a pseudo-derivative, PI of the rate; None of
    any other."""
    x, gains, period = fitted.numbers, fitted.law.gains(), fitted.law.period
    of = tuple({"error": "theta", "rate_error": "theta_dot"}.get(name, name) for name in fitted.of)
    if fitted.order == 0 and of != ("theta_dot",):
        return Controller(kp=gains["kp"], kd=gains.get("kd", 0.0), derivative_time_constant=0.0, period=period,
                          law="gyro")
    if of == ("theta_dot",) and (fitted.order == 0 or (fitted.order == 1 and abs(x[0] - 1.0) < OF_INTEGRAL)):
        return Controller(kp=gains["kp"], kd=0.0, derivative_time_constant=0.0, period=period, law="rate",
                          ki=gains.get("ki", 0.0))
    if of == ("theta",) and fitted.order == 1 and 0.0 <= x[0] < 1.0 - OF_INTEGRAL:
        tau = period * float(x[0]) / (1.0 - float(x[0]))
        kp = float(x[1] + x[2]) / (1.0 - float(x[0]))
        return Controller(kp=kp, kd=(float(x[1]) - kp) * (tau + period), derivative_time_constant=tau, period=period)
    return None
