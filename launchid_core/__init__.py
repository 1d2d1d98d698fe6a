"""launchid_core: on-board identification of a launcher's rotational dynamics.

What flies: fixed memory, bounded time, one sample at a time.  It knows no clock,
file, simulator or print.  numpy and numba only.
"""

from .config import FORMULATIONS, NOISE_LEVELS, Config
from .estimate import Change, Estimate, Level, Tracked, Uncertainty
from .estimator import Estimator
from .library import LIBRARIES, function_value, parse_term, polynomial, term_name
from .model import Model
from .port import Port, port_of
from .sample import Sample
from .sparse import SOLVERS
from .status import EstimateStatus, Status
from .uncertainty import BANDS, EDGES

__all__ = ["BANDS", "EDGES", "FORMULATIONS", "LIBRARIES", "NOISE_LEVELS", "SOLVERS", "Change", "Config",
           "Estimate", "EstimateStatus", "Estimator", "Level", "Model", "Port", "Sample", "Status",
           "Tracked", "Uncertainty", "function_value", "parse_term", "polynomial", "port_of", "term_name"]
