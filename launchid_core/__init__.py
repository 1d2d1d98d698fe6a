"""launchid_core: on-board identification of a launcher's rotational dynamics.

What flies: fixed memory, bounded time, one sample at a time.  It knows no clock,
file, simulator or print.  numpy and numba only.
"""

from .config import FORMULATIONS, Config
from .estimate import Estimate
from .estimator import Estimator
from .library import LIBRARIES, polynomial
from .sample import Sample
from .sparse import SOLVERS
from .status import EstimateStatus, Status

__all__ = ["FORMULATIONS", "LIBRARIES", "SOLVERS", "Config", "Estimate", "EstimateStatus", "Estimator",
           "Sample", "Status", "polynomial"]
