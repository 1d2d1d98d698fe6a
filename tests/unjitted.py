"""The project's kernels as they are written: a second, un-jitted copy of its packages in this process.

`inner` kernels cannot be called from Python, and to compile one with a wrapper takes up to twenty seconds; as Python a
sample takes a millisecond.  That compiled and plain are the same bits is tested where whole flights are.
"""

import importlib
import sys
from functools import cache
from types import ModuleType
from typing import Any

import numba

PACKAGES = ("launchid_core", "sim", "launchid")


@cache
def unjitted_module(name: str) -> ModuleType:
    """Return the module of that name of the copy; what it imports of the project is the copy's too."""
    compiled = {key: module for key, module in sys.modules.items() if key.split(".")[0] in PACKAGES}
    was_off, numba.config.DISABLE_JIT = numba.config.DISABLE_JIT, 1
    for key in compiled:
        del sys.modules[key]
    sys.modules.update(_copy)
    try:
        return importlib.import_module(name)
    finally:
        numba.config.DISABLE_JIT = was_off
        _copy.update({key: sys.modules.pop(key) for key in list(sys.modules) if key.split(".")[0] in PACKAGES})
        sys.modules.update(compiled)


_copy: dict[str, ModuleType] = {}


def unjitted(kernel: Any) -> Any:
    """Return the copy's function of a kernel."""
    function = getattr(kernel, "py_func", kernel)
    return getattr(unjitted_module(function.__module__), function.__name__)
