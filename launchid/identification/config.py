"""Choose the estimator's configuration for a log: formulation, library, window, period."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from launchid_core import MAX_ROWS, Config
from sim.errors import InputError, UsageError
from sim.nominal import Nominal
from sim.onboard import onboard_model
from sim.sections import SERVO

from ..formatting import slow_hint
from ..log.log import Log
from ..log.steps import with_steps
from ..weakform.prepare import near_all

TERM_OF = {"aero_damping": "theta_dot", "aero_cubic": "theta^3", "friction": "sign(theta_dot)",
           **dict.fromkeys(("thrust_misalignment", "attitude_bias", "actuator_bias", "nozzle_sensor_bias",
                            "steady_wind", "moment_step"), "1")}   # effect: the term by which it acts


def chosen_formulation(log: Log, nominal: Nominal | None, asked: str | None, tracked: bool) -> str:
    """Return the formulation: `asked`, else filtered if the filter has a model of the nominal, else measured if the log
    has theta_ddot, else integral.

    UsageError if `asked` or `tracked` needs a nominal or a column theta_ddot that is not there.
    """
    default = "measured" if "theta_ddot" in log.columns else "integral"
    formulation = asked or ("filtered" if nominal is not None and not is_stand(nominal) else default)
    if formulation == "measured" and "theta_ddot" not in log.columns:
        raise UsageError("formulation measured needs the column theta_ddot, which the log lacks")
    if formulation == "filtered" and nominal is None:
        raise UsageError("formulation filtered needs a nominal (profile, actuator, noises)")
    if tracked and formulation != "filtered":
        raise UsageError("--tracked needs --nominal, with which --formulation is filtered")
    return formulation


def is_weak(log: Log, nominal: Nominal | None, formulation: str | None, library: str | None,
            choices: Mapping[str, Any]) -> bool:
    """Whether the weak form gives the numbers: no formulation and no sparse regression is chosen, the filter has no
    model of the nominal or there is none, and theta_ddot is not measured."""
    sparse = (choices.get("solver", "stls") != "stls" or choices.get("threshold") is not None
              or choices.get("compression", 1) != 1 or str(library).startswith("quadratic"))
    return formulation is None and not sparse and "theta_ddot" not in log.columns and (
        nominal is None or is_stand(nominal))


def refuse_too_long(log: Log) -> None:
    """Raise InputError if a log is too long for one window: more than MAX_ROWS rows, over more than as many periods."""
    period, t = log.period, log.t[np.isfinite(log.t)]
    if len(t) > MAX_ROWS and np.ptp(t) > MAX_ROWS * period:
        raise InputError(f"{log.path}: too long for one window: at most {MAX_ROWS * period:g} s at this rate; "
                         "cut it into windows with --window S")


def is_stand(nominal: Nominal) -> bool:
    """Whether the filter has no model of the nominal: its plant is given by its terms, or it has no actuator."""
    return bool(nominal.terms) or nominal.actuator is None


def stand_library(nominal: Nominal) -> tuple[str, ...]:
    """Return the library of a nominal: theta, beta, [vehicle.terms] and the terms of its effects; where there are such
    terms, theta and beta only if their coefficients are not 0."""
    rigid = (("theta", float(nominal.vehicle.a6[0])), ("beta", float(nominal.vehicle.k1[0])))
    effects = (str(each.values[0]) if each.name == "missing_term" else TERM_OF.get(each.name, "")
               for each in nominal.effects)
    return tuple(dict.fromkeys((
        *(term for term, value in rigid if value != 0.0 or not nominal.terms),
        *(term for term, _ in nominal.terms), *(term for term in effects if term))))


def log_config(log: Log, nominal: Nominal | None, window: float | str, formulation: str | None, tracked: bool,
               bridged: float = 0.0, **choices: Any) -> Config:
    """Return the estimator's Config for a log; UsageError for options that do not fit it, InputError for a bad clock.

    window   seconds, or `all`: one window of the whole log;  choices   further fields of Config
    bridged  [s]  step up to which rows that were not measured are no gap (`log.check.CheckedLog`)
    """
    formulation = chosen_formulation(log, nominal, formulation, tracked)
    if nominal is not None and formulation != "filtered" and choices.get("library") == "rigid-body":
        choices["library"] = stand_library(nominal)
    model = None
    if formulation == "filtered" and nominal is not None:
        model = onboard_model(with_steps(nominal, log), log.period, log.path)
    if window == "all":
        t = log.t[log.in_range("t") & log.in_range("theta") & log.in_range("beta")]
        t = t if len(t) else log.t[np.isfinite(log.t)]
        t = t[near_all(t, log.period)]
        timing: dict[str, Any] = whole_log(len(t), log.period, float(np.min(t)), float(np.max(t)))
    else:
        try:
            timing = {"window": float(window), "sample_period": log.period}
        except (TypeError, ValueError):
            raise UsageError(f"window {window!r}: expected seconds or 'all'") from None
    if bridged > 0.0:
        choices["max_gap"] = bridged
    try:
        return Config(**timing, formulation=formulation, model=model, **choices)
    except ValueError as error:
        if str(error).startswith("sample_period"):
            raise InputError(f"{log.path}: column t: {error}{slow_hint(log.period)}") from None
        if window == "all" and str(error).startswith("window"):
            raise InputError(f"{log.path}: too short for a window: {error}") from None
        raise UsageError(f"{error}{slow_hint(log.period)}") from None


def servo_note(log: Log, nominal: Nominal | None, config: Config) -> tuple[str, ...]:
    """Return one line, else (), if the nominal leaves the servo uncertain (a sigma) and the log cannot tell more."""
    servo = None if nominal is None else nominal.actuator
    if nominal is None or servo is None or servo.is_known:
        return ()
    there = log.in_range("beta_cmd") & log.in_range("beta") if "beta_cmd" in log.columns else np.zeros(0, bool)
    if log.in_range("beta_cmd").any() and not log.in_range("beta").any():
        return ()   # the motion tells, behind the command
    if not there.any():
        lacking = "column beta_cmd is missing: without the command"
    elif np.array_equal(log.beta[there], log.beta_cmd[there]):
        lacking = "column beta is the command itself: without a sensor of the nozzle"
    elif config.missing_commands > 0.0:
        lacking = "slower than the controller: without the commands between its rows"
    else:
        return ()
    names = ", ".join(name for name in SERVO if getattr(servo, f"{name}_sigma") > 0.0)
    return (f"{log.path}: {lacking} nothing is known of the servo's {names} but what {nominal.path} declares; log it, "
            "or declare the servo known",)


def whole_log(rows: int, period: float, t_first: float, t_last: float) -> dict[str, float]:
    """Return the Config fields `window` and `sample_period` [s] of one window for `rows` rows of a whole log."""
    span = max(t_last - t_first, period)
    period = min(period, span / max(rows - 1, 1))
    return {"window": span + period, "sample_period": period}
