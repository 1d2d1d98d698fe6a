"""launchid_core: on-board identification of a launcher's rotational dynamics.

What flies: fixed memory, bounded time, one sample at a time.  It knows no clock, file, simulator or print.  numpy and
numba only; what needs numba is imported when its name is first asked for.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from .choices import FORMULATIONS, NOISE_LEVELS, SLOWEST, SOLVERS
from .compiling import compile_listeners
from .sample import Sample
from .status import EstimateStatus, Status
from .version import VERSION

if TYPE_CHECKING:
    from .algebra.library import LIBRARIES, function_value, parse_term, polynomial, term_name
    from .cache import cache_folder
    from .config import MAX_ROWS, Config
    from .estimate import Change, Estimate, Level, Mode, Tracked, Uncertainty
    from .estimator import Estimator
    from .kernels import compiled
    from .model import Model, Oscillator
    from .order.entries import precompile
    from .port import Port, port_of
    from .watch.uncertainty import BANDS, EDGES

__version__ = VERSION

__all__ = ["BANDS", "EDGES", "FORMULATIONS", "LIBRARIES", "MAX_ROWS", "NOISE_LEVELS", "SLOWEST", "SOLVERS", "Change",
           "Config", "Estimate", "EstimateStatus", "Estimator", "Level", "Mode", "Model", "Oscillator", "Port",
           "Sample", "Status", "Tracked", "Uncertainty", "__version__", "cache_folder", "compile_listeners",
           "compiled", "function_value", "parse_term", "polynomial", "port_of", "precompile", "term_name"]


def _homes() -> Iterator[Any]:
    """The modules that the names above are in, each imported when it is asked: a simulator needs no estimator."""
    from . import cache, kernels
    yield from (cache, kernels)
    from .algebra import library
    yield library
    from . import config, estimate, model
    yield from (config, estimate, model)
    from .watch import uncertainty
    yield uncertainty
    from . import estimator, port
    from .order import entries
    yield from (entries, estimator, port)


def __getattr__(name: str) -> Any:
    """One of the names above that is not there yet."""
    if name in __all__:
        for module in _homes():
            if hasattr(module, name):
                globals()[name] = getattr(module, name)
                return globals()[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
