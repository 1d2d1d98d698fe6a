"""Kernels that only kernels call, compiled so that a test can call them too; kept on disk, so that one process does."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numba

from launchid_core import kernel_cache, parts

if kernel_cache.KNOWN:
    class _Locator(kernel_cache._Locator):
        """Folders of their own: the project keeps the same functions under the same names, as parts."""

        @classmethod
        def from_function(cls, py_func: Any, py_file: str) -> Any:
            made = super().from_function(py_func, py_file)
            if made:
                made._folder = made._folder.with_name(f"tests.{made._folder.name}")
            return made

    class _Impl(kernel_cache._Impl):
        _locator_classes = (_Locator,)

    class _Files(kernel_cache._Files):
        _impl_class = _Impl


class _Kept(kernel_cache.Kept):
    def _made(self) -> Any:
        if self._files is None:
            try:
                self._files = _Files(self._function)
            except (RuntimeError, OSError):  # nowhere to keep it
                return super()._made()
        return self._files


@cache
def compiled(kernel: Any) -> Callable[..., Any]:
    """An `inner` kernel with the wrapper that Python needs; un-jitted where numba is told not to compile."""
    function = getattr(kernel, "py_func", kernel)
    made: Any = numba.njit(error_model="numpy", **parts.OF_AN_ENTRY)(function)
    if kernel_cache.KNOWN and hasattr(made, "_cache"):
        made._cache = _Kept(function)
    return made
