"""The commands, one file each: `add` has a command's options, `run` does it.

Inputs are read, outputs that cannot be written are refused, then the result is computed (`launchid.results`).  What a
command needs is imported when it runs; its files are read before anything is that compiles.
"""

from . import (
    campaign,
    convert,
    diagnose,
    effects,
    export_c,
    fit_lft,
    identify,
    margins,
    nominal,
    plan,
    reproduce,
    simulate,
    uncertainty,
    warm,
    watch,
)

COMMANDS = (reproduce, simulate, identify, nominal, plan, diagnose, margins, uncertainty, fit_lft, export_c, campaign,
            convert, watch, effects, warm)
