"""launchid from Python: what the command does, from paths, data frames or arrays, with results to look at.

    import launchid
    flight = launchid.simulate("vega_like", seed=3, effects=["control_loss:fraction=0.3,time=60"])
    found = launchid.identify(flight, "vega_like", window=5, tracked=True)
    print(found.summary()); found.plot("v.png"); found.to_frame()

A log is a path, `-`, a data frame (pandas, polars) or a mapping of arrays with the columns t, theta, beta and what else
was measured, in SI units; a result of `simulate`; or what `read_log` returns.  A nominal is a path, a built-in name,
or what `load_nominal` returns.  What cannot be used raises `InputError`, wrong parameters `UsageError`; what the data
check finds is a `DataWarning`, with strict=True an `InputError`.

The functions and results are those of the commands; the estimator that flies is `launchid_core`.  Names are imported
when they are first asked for, so that the command answers at once.
"""

import typing as _typing

if _typing.TYPE_CHECKING:
    from launchid_core import __version__

    from .api import (
        DataWarning,
        InputError,
        Log,
        LogSource,
        Nominal,
        NominalSource,
        UsageError,
        campaign,
        compare,
        diagnose,
        export_c,
        fit_lft,
        identify,
        load_nominal,
        margins,
        nominal,
        onboard_model,
        plan,
        read_log,
        show,
        simulate,
        uncertainty,
    )

__all__ = ["DataWarning", "InputError", "Log", "LogSource", "Nominal", "NominalSource", "UsageError", "__version__",
           "campaign", "compare", "diagnose", "export_c", "fit_lft", "identify", "load_nominal", "margins", "nominal",
           "onboard_model", "plan", "read_log", "show", "simulate", "uncertainty"]


def __dir__() -> list[str]:
    """Return the public names."""
    return __all__


def __getattr__(name: str) -> _typing.Any:
    """Return a public name, imported at its first use."""
    if name in __all__:
        from launchid_core import __version__

        from . import api
        globals()[name] = __version__ if name == "__version__" else getattr(api, name)
        return globals()[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
