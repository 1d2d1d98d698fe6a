"""The folder in which numba keeps compiled code: one of the user's own, named after the sources.

Not part of what flies: it is used while modules are imported, when an `Estimator` is made, and at the process' end.

The folder of a package is named after a digest of all its sources, this package's and the versions, so an edit in any
file compiles anew what is asked for, and two checkouts share one place without harm.  It is set as numba's cache folder
only while our functions are decorated: a host's own numba code keeps its place.  The place: LAUNCHID_CACHE, or
NUMBA_CACHE_DIR, or the user's cache folder.  If it cannot be written, kernels are compiled in each process: no error.

What numba loads from there runs.  So the folder has to be this user's, and nobody else may write to it; and each file
has its digest beside it: what is damaged, or was not finished, is deleted and compiled anew.
"""

import atexit
import contextlib
import hashlib
import os
import platform
import shutil
import stat
import sys
import threading
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numba

config: Any = numba.config
SUM = ".sum"       # behind the name of a file: its digest
OLD = 8            # folders that are kept: as many checkouts and versions may be in use in turn
GIVEN = config.CACHE_DIR  # by the host
_used: list[Path] = []    # folders of this process
alone = threading.RLock()  # who decorates or compiles


def cache_folder() -> Path | None:
    """The user's folder of this project's caches: LAUNCHID_CACHE, or the system's usual place; None without a home."""
    chosen = os.environ.get("LAUNCHID_CACHE")
    if chosen:
        return Path(chosen).expanduser().absolute()
    usual = {"darwin": ("", "~/Library/Caches"), "win32": ("LOCALAPPDATA", "~/AppData/Local")}
    variable, fallback = usual.get(sys.platform, ("XDG_CACHE_HOME", "~/.cache"))
    try:
        return Path(os.environ.get(variable) or fallback).expanduser() / "launchid"
    except RuntimeError:
        return None


def is_own(path: Path) -> bool:
    """Whether a folder or file is this user's own, and no link (where the system says so)."""
    about = path.lstat()
    return not hasattr(os, "getuid") or (about.st_uid == os.getuid() and not stat.S_ISLNK(about.st_mode))


def is_private(path: Path) -> bool:
    """Whether a folder or file is this user's own and nobody else may write to it."""
    return is_own(path) and not (hasattr(os, "getuid") and path.lstat().st_mode & (stat.S_IWGRP | stat.S_IWOTH))


def digest_of(package: str) -> str:
    """Digest of the sources of a package and of this one, of the versions and the processor."""
    words = (numba.__version__, sys.version, platform.machine(), os.environ.get("NUMBA_BOUNDSCHECK", ""))
    digest = hashlib.blake2b(repr(words).encode(), digest_size=12)
    for name in sorted({package, __name__.partition(".")[0]}):
        file = Path(str(sys.modules[name].__file__))
        for path in sorted(file.parent.rglob("*.py")) if hasattr(sys.modules[name], "__path__") else [file]:
            digest.update(f"{name}/{path.name}".encode() + path.read_bytes())
    return digest.hexdigest()


@cache
def folder_of(package: str) -> Path | None:
    """The folder of a package's kernels, made and looked through; None if there is none that is safe."""
    place = Path(GIVEN).absolute() if GIVEN and not os.environ.get("LAUNCHID_CACHE") else cache_folder()
    if place is None or config.DISABLE_JIT or not getattr(sys.modules.get(package), "__file__", None):
        return None
    try:
        folder = place / "kernels" / f"{package}-{digest_of(package)}"
        place.mkdir(parents=True, exist_ok=True)
        for each in (folder.parent, folder):
            each.mkdir(mode=0o700, exist_ok=True)
        if not (is_private(folder) and is_private(folder.parent) and os.access(folder, os.W_OK)):
            return None
        _drop_damaged(folder)
        _drop_old(folder)
    except OSError:
        return None
    if not _used:
        atexit.register(finish)
    _used.append(folder)
    return folder


def _files(folder: Path) -> Iterator[Path]:
    """The files that numba wrote into a folder."""
    return (path for path in folder.rglob("*.nb[ci]") if path.is_file())


def _sum(path: Path) -> str:
    return hashlib.blake2b(path.read_bytes(), digest_size=16).hexdigest()


def _drop_damaged(folder: Path) -> None:
    """Delete files whose digest is missing or another, and what is not this user's own."""
    for path in list(_files(folder)):
        beside = path.with_name(path.name + SUM)
        try:
            sound = is_private(path) and is_own(path.parent) and beside.read_text() == _sum(path)
        except (OSError, ValueError):
            sound = False
        if not sound:
            path.unlink(missing_ok=True)


def _drop_old(folder: Path) -> None:
    """Delete a package's folders but for the OLD used last."""
    os.utime(folder)
    package = folder.name.partition("-")[0]
    with contextlib.suppress(OSError):  # another process may delete one meanwhile
        others = sorted(folder.parent.glob(f"{package}-*"), key=lambda path: path.stat().st_mtime, reverse=True)
        for path in others[OLD:]:
            shutil.rmtree(path, ignore_errors=True)


def finish() -> None:
    """Put the digests of what was compiled since beside it."""
    for folder in _used:
        with contextlib.suppress(OSError):
            for path in _files(folder):
                beside = path.with_name(path.name + SUM)
                if not beside.exists() or beside.stat().st_mtime_ns < path.stat().st_mtime_ns:
                    part = beside.with_name(f"{beside.name}.{os.getpid()}")
                    path.chmod(0o600)
                    part.write_text(_sum(path))
                    os.replace(part, beside)


@contextlib.contextmanager
def kept_apart(function: Callable[..., Any]) -> Iterator[bool]:
    """A context in which numba's cache folder is that of the function's package; gives whether there is one."""
    folder = folder_of(function.__module__.partition(".")[0])
    with alone:
        usual = config.CACHE_DIR
        try:
            config.CACHE_DIR = str(folder) if folder else usual
            yield folder is not None
        finally:
            config.CACHE_DIR = usual
