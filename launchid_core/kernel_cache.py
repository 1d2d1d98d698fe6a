"""Where compiled kernels are kept: outside the packages, under a name that their sources make.

Not part of what flies: it is asked when a kernel is first called (an `Estimator` does that when it is made), never
after.  The one file of this package that knows files and locks.

A kernel's folder is named after its module and a digest of all that decides its machine code but the processor (which
numba's index knows): the sources of the module and of every module of these packages that it imports, at any distance,
the versions, numba's settings.  So an edit in *another* file is noticed, two checkouts and two installations share one
place without harm, and nothing stays behind in a package when pip replaces it.

The place: LAUNCHID_CACHE, or NUMBA_CACHE_DIR, or the user's cache folder.  If it cannot be written, kernels are
compiled in each process: no error.  Two processes that need the same kernel compile it once; the second waits.
"""

import contextlib
import hashlib
import os
import re
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numba
import numba.core.caching
import numba.core.config

from .compiling import compile_listeners
from .parts import is_part, rebuilt

try:
    import fcntl
except ImportError:  # not a POSIX system: both compile
    fcntl = None  # type: ignore[assignment]

caching: Any = numba.core.caching  # no public part of numba: `keep` does without if it is another than here
config: Any = numba.core.config

PACKAGES = ("launchid_core", "sim", "launchid")  # whose sources are followed
SETTINGS = ("BOUNDSCHECK", "OPT", "DEBUGINFO_DEFAULT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "ENABLE_AVX")
KEEP = 4             # folders of a module: as many checkouts and versions may be in use in turn
WAIT, POLL = 300.0, 0.02  # s, for another process that compiles the same kernel; between two looks
STARTED = time.time()

_IMPORT = re.compile(r"^[ \t]*(?:from[ \t]+([.\w]+)[ \t]+import[ \t]*(\([^)]*\)|[^\n#]*)|import[ \t]+([^\n#]*))",
                     re.MULTILINE)


def cache_folder() -> Path | None:
    """The user's folder of this project's caches: LAUNCHID_CACHE, or the system's usual place; None without a home."""
    own = os.environ.get("LAUNCHID_CACHE")
    if own:
        return Path(own)
    usual = {"darwin": ("", "~/Library/Caches"), "win32": ("LOCALAPPDATA", "~/AppData/Local")}
    variable, fallback = usual.get(sys.platform, ("XDG_CACHE_HOME", "~/.cache"))
    try:
        return Path(os.environ.get(variable) or fallback).expanduser() / "launchid"
    except RuntimeError:
        return None


def kernel_folder() -> Path | None:
    """Where kernels are kept."""
    if config.CACHE_DIR and not os.environ.get("LAUNCHID_CACHE"):
        return Path(config.CACHE_DIR)
    folder = cache_folder()
    return folder and folder / "kernels"


# ---- a module's sources


@cache
def source_of(module: str) -> tuple[str, str] | None:
    """(path, text) of a module of these packages, or of any that is loaded; None if there is none."""
    loaded = sys.modules.get(module)
    path = getattr(loaded, "__file__", None)
    if path is None:
        top, _, rest = module.partition(".")
        package = getattr(sys.modules.get(top), "__file__", None)
        if top not in PACKAGES or package is None:
            return None
        stem = Path(package).parent.joinpath(*rest.split("."))
        path = next((str(p) for p in (stem.with_suffix(".py"), stem / "__init__.py") if p.is_file()), None)
    try:
        return (path, Path(path).read_text(encoding="utf-8")) if path else None
    except (OSError, ValueError):
        return None


def imports(module: str, path: str, text: str) -> Iterator[tuple[str, str]]:
    """(module, name) of each name that a source takes by `from`; (module, "") of `import`."""
    package = module.split(".") if path.endswith("__init__.py") else module.split(".")[:-1]
    for base, names, plain in _IMPORT.findall(text):
        if plain:
            yield from ((word.split()[0], "") for word in plain.split(",") if word.split())
            continue
        dots = len(base) - len(base.lstrip("."))
        start = package[:len(package) - dots + 1] if dots else []
        whole = ".".join([*start, *([base.lstrip(".")] if base.lstrip(".") else [])])
        yield from ((whole, word.split()[0]) for word in names.strip("()").split(",") if word.split())


def home(module: str, name: str) -> str:
    """The module that a name comes from: itself, or the one from which a package takes it."""
    if name and source_of(f"{module}.{name}"):
        return f"{module}.{name}"
    found = source_of(module)
    if name and found and found[0].endswith("__init__.py"):
        for other, given in imports(module, *found):
            if given == name and other != module:
                return home(other, name)
    return module


@cache
def needs(module: str) -> frozenset[str]:
    """The modules of these packages that a module imports itself."""
    found = source_of(module)
    if found is None:
        return frozenset()
    taken = {home(other, name) for other, name in imports(module, *found) if other.split(".")[0] in PACKAGES}
    return frozenset(taken - {module})


@cache
def stamp(module: str) -> str | None:
    """Digest of all that decides a module's machine code but the processor.

    None when a source is not to be had, or was edited since this process began: what runs is not what it says.
    """
    todo, known = [module], {module}
    while todo:
        new = needs(todo.pop()) - known
        known |= new
        todo += new
    digest = hashlib.sha256(repr((numba.__version__, sys.version_info, sys.implementation.name,
                                  [getattr(config, name, None) for name in SETTINGS])).encode())
    for name in sorted(known):
        found = source_of(name)
        if found is None or STARTED < os.stat(found[0]).st_mtime <= time.time():
            return None
        digest.update(f"{name}\n{len(found[1])}\n{found[1]}".encode())
    return digest.hexdigest()[:20]


# ---- a kernel's cache


KNOWN = all(hasattr(caching, name)
            for name in ("CompileResultCacheImpl", "FunctionCache", "NullCache", "_CacheLocator"))

if KNOWN:
    class _Locator(caching._CacheLocator):  # type: ignore[misc]
        """Tells numba the folder."""

        def __init__(self, function: Any, path: str, folder: Path, mark: str) -> None:
            self._py_file, self._folder, self._mark = path, folder, mark
            self._line = function.__code__.co_firstlineno

        @classmethod
        def from_function(cls, py_func: Any, py_file: str) -> Any:
            """None where nothing can be kept."""
            module, folder = py_func.__module__, kernel_folder()
            mark = stamp(module)
            return folder and mark and cls(py_func, py_file, folder / f"{module}-{mark}", mark)

        def get_cache_path(self) -> str:
            return str(self._folder)

        def get_source_stamp(self) -> str:
            return self._mark

        def get_disambiguator(self) -> str:
            return str(self._line)

        def ensure_cache_path(self) -> None:
            """Make the folder; the oldest of the module's others go."""
            if not self._folder.is_dir():
                self._folder.mkdir(parents=True, exist_ok=True)
                module = self._folder.name.removesuffix(self._mark)
                others = [p for p in self._folder.parent.glob(f"{module}*") if len(p.name) == len(self._folder.name)]
                for old in sorted(others, key=_age)[KEEP:]:
                    shutil.rmtree(old, ignore_errors=True)

    class _Impl(caching.CompileResultCacheImpl):  # type: ignore[misc]
        _locator_classes = (_Locator,)

        def rebuild(self, target_context: Any, payload: Any) -> Any:
            """What numba knows of a kernel, from what was kept."""
            return (rebuilt if is_part(payload) else super().rebuild)(target_context, payload)

    class _Files(caching.FunctionCache):  # type: ignore[misc]
        _impl_class = _Impl


def _age(path: Path) -> float:
    try:
        return -path.stat().st_mtime
    except OSError:
        return 0.0


class Kept:
    """What numba asks for a compiled kernel: made when it first asks, and whatever is wrong with a file is a miss."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        self._files: Any = None
        self._lock: int | None = None

    def _made(self) -> Any:
        if self._files is None:
            try:
                self._files = _Files(self._function)
            except (RuntimeError, OSError):  # numba's word for nowhere to keep it
                self._files = caching.NullCache()
        return self._files

    @property
    def cache_path(self) -> str | None:
        """The folder."""
        path: str | None = self._made().cache_path
        return path

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The kernel compiled for these types, or None: then the caller compiles it, and no other process does."""
        found = self._load(sig, target_context)
        if found is None and self._wait():
            found = self._load(sig, target_context)
            if found is not None:
                self._release()
        if found is None:
            for listener in compile_listeners:
                listener(self._function.__module__, self._function.__qualname__)
        return found

    def _load(self, sig: Any, target_context: Any) -> Any:
        try:
            return self._made().load_overload(sig, target_context)
        except Exception:  # a torn file raises whatever it likes; then it is compiled anew, and replaced
            with contextlib.suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep it, if that can be."""
        try:
            with contextlib.suppress(OSError):
                self._made().save_overload(sig, data)
        finally:
            self._release()

    def _wait(self) -> bool:
        """Take the kernel's lock; False where there is none, or it is ours since a compilation that failed."""
        folder = self.cache_path
        if fcntl is None or folder is None or self._lock is not None:
            return False
        try:
            self._files._impl.locator.ensure_cache_path()
            name = f"{self._files._impl.filename_base}.lock"
            self._lock = os.open(Path(folder) / name, os.O_CREAT | os.O_RDWR, 0o600)
        except OSError:
            return False
        until = time.monotonic() + WAIT
        while time.monotonic() < until:
            try:
                fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                return True
            except BlockingIOError:
                time.sleep(POLL)
            except OSError:  # a file system without locks
                break
        return False

    def _release(self) -> None:
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def enable(self) -> None:
        """Part of what numba may ask."""

    def disable(self) -> None:
        """Part of what numba may ask."""

    def flush(self) -> None:
        """Forget what is kept."""
        self._made().flush()


def keep(dispatcher: Any) -> Any:
    """Give a jitted function its cache; an un-jitted one is returned as it is."""
    if KNOWN and hasattr(dispatcher, "_cache"):
        dispatcher._cache = Kept(dispatcher.py_func)
    elif hasattr(dispatcher, "enable_caching"):
        dispatcher.enable_caching()
    return dispatcher
