"""The project as it is written: a second copy of its packages in this process, with numba off.

`inner` kernels cannot be called from Python, and to compile one with a wrapper takes up to twenty seconds; as Python a
sample takes a millisecond.  That compiled and un-jitted are the same bits is tested where whole flights are.
"""

import contextlib
import functools
import importlib
import sys
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import numba

PACKAGES = ("launchid_core", "sim", "launchid")
_copy: dict[str, ModuleType] = {}


def _taken_out() -> dict[str, ModuleType]:
    """The project's modules, which are then no longer among the imported ones."""
    return {name: sys.modules.pop(name) for name in list(sys.modules) if name.split(".")[0] in PACKAGES}


@contextlib.contextmanager
def unjitted_packages() -> Iterator[None]:
    """Import what is imported of the project from the copy."""
    compiled, was_off, numba.config.DISABLE_JIT = _taken_out(), numba.config.DISABLE_JIT, 1
    sys.modules.update(_copy)
    try:
        yield
    finally:
        numba.config.DISABLE_JIT = was_off
        _copy.update(_taken_out())
        sys.modules.update(compiled)


def unjitted_module(name: str) -> ModuleType:
    """Return the copy's module of that name."""
    with unjitted_packages():
        return importlib.import_module(name)


@functools.cache
def unjitted(kernel: Any) -> Any:
    """Return the copy's function of a kernel."""
    function = getattr(kernel, "py_func", kernel)
    return getattr(unjitted_module(function.__module__), function.__name__)
