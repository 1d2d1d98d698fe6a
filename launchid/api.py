"""Public functions of the package `launchid`: those of the commands, for callers from Python."""

from sim.errors import InputError, UsageError
from sim.onboard import onboard_model
from sim.sections import Nominal

from .commands import campaign as of_campaign
from .commands import compare as of_compare
from .commands import diagnose as of_diagnose
from .commands import export_c as of_export_c
from .commands import fit_lft as of_fit_lft
from .commands import identify as of_identify
from .commands import margins as of_margins
from .commands import nominal as of_nominal
from .commands import plan as of_plan
from .commands import show as of_show
from .commands import simulate as of_simulate
from .commands import uncertainty as of_uncertainty
from .log.log import Log
from .sources import DataWarning, LogSource, NominalSource, from_python, load_nominal, read_log

__all__ = ["DataWarning", "InputError", "Log", "LogSource", "Nominal", "NominalSource", "UsageError", "campaign",
           "compare", "diagnose", "export_c", "fit_lft", "identify", "load_nominal", "margins", "nominal",
           "onboard_model", "plan", "read_log", "show", "simulate", "uncertainty"]

campaign = from_python(of_campaign.campaign)
compare = from_python(of_compare.compare)
diagnose = from_python(of_diagnose.diagnose)
export_c = from_python(of_export_c.export_c)
fit_lft = from_python(of_fit_lft.fit_lft)
identify = from_python(of_identify.identify)
margins = from_python(of_margins.margins)
nominal = from_python(of_nominal.nominal)
plan = from_python(of_plan.plan)
show = from_python(of_show.show)
simulate = from_python(of_simulate.simulate)
uncertainty = from_python(of_uncertainty.uncertainty)
