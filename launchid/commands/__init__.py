"""The commands, one file each: `add` has a command's options, `run` does it.

Inputs are read, outputs that cannot be written are refused, then the result is computed (`launchid.results`).  What a
command needs is imported when it runs; its files are read before anything is that compiles.
"""

from . import (
    campaign,
    compare,
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
    show,
    simulate,
    uncertainty,
    warm,
    watch,
)

COMMANDS = (simulate, show, identify, nominal, diagnose, compare, margins, uncertainty, plan, fit_lft, campaign,
            export_c, convert, watch, effects, warm, reproduce)
