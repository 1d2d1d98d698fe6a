"""The folders in which numba keeps compiled code: one for each module with kernels, named after its sources.

Not part of what flies: it is used while modules are imported, and when an `Estimator` is made.  numba compiles anew
after an edit of a function's own file, but does not see edits in files that it imports; so a folder is named after a
digest of the module's source, of all that it imports, of the versions and of numba's settings (but of threads).

The folder is set as numba's only while our functions are decorated: a host's own code keeps its place.  If it cannot be
written or has no room, kernels are compiled in each process: no error.  What numba loads from there runs, so it has to
be this user's, and nobody else may write to it.  More: docs/developing.md, "Compiled code".
"""

import contextlib
import errno
import hashlib
import os
import platform
import re
import shutil
import stat
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numba

config: Any = numba.config
HOST_FOLDER = config.CACHE_DIR  # by the host
OURS = ("launchid_core", "sim", "launchid")  # each takes constants and kernels from those before it
UNUSED_TIME = 30 * 86400.0  # s after which a folder that no process used is deleted
ROOM = 1 << 26         # bytes that must be free: twice what all kernels take; the largest takes a 64th of it
IMPORT = re.compile(r"^from (\.*)([\w.]*) import (\([^)]*\)|.*)", re.M)  # at the top level: kernels' names
alone = threading.RLock()  # who decorates or compiles


def cache_folder() -> Path | None:
    """Return the user's folder of this project's caches: LAUNCHID_CACHE or the usual place; None without a home."""
    chosen = os.environ.get("LAUNCHID_CACHE")
    if chosen:
        return Path(chosen).expanduser().absolute()
    usual = {"darwin": ("", "~/Library/Caches"), "win32": ("LOCALAPPDATA", "~/AppData/Local")}
    variable, fallback = usual.get(sys.platform, ("XDG_CACHE_HOME", "~/.cache"))
    try:
        return Path(os.environ.get(variable) or fallback).expanduser() / "launchid"
    except RuntimeError:
        return None


@cache
def looked_through(path: Path) -> tuple[bytes, list[Path]]:
    """Return the digest of a source file, and what it imports: files of its own package, folders of our others.

    Of a folder the digest is that of all its sources, which import nothing further.
    """
    if path.is_dir():
        return hashlib.blake2b(b"".join(file.read_bytes() for file in sorted(path.rglob("*.py")))).digest(), []
    source, found = path.read_bytes(), list[Path]()
    for dots, module, names in IMPORT.findall(source.decode()):
        package = module.partition(".")[0]
        if dots:
            target = path.parents[len(dots) - 1].joinpath(*module.split("."))
            found += filter(Path.is_file, [target.with_suffix(".py"), target / "__init__.py",
                                           *(target / f"{name}.py" for name in re.findall(r"\w+", names))])
        elif package in OURS:
            found += [Path(str(sys.modules[name].__file__)).parent for name in OURS[:OURS.index(package) + 1]]
    return hashlib.blake2b(path.name.encode() + source).digest(), found


def digest_of(module: str) -> str:
    """Return the digest of a module's source and of all that it imports, of the versions and of numba's settings."""
    settings = sorted(item for item in os.environ.items()
                      if item[0].startswith("NUMBA_") and "CACHE" not in item[0] and "THREAD" not in item[0])
    digest = repr((numba.__version__, sys.version, platform.machine(), settings)).encode()
    digests: dict[Path, bytes] = {}
    waiting = [Path(str(sys.modules[module].__file__))]
    while waiting:
        path = waiting.pop()
        if path not in digests:
            digests[path], imported = looked_through(path)
            waiting += imported
    return hashlib.blake2b(digest + b"".join(sorted(digests.values())), digest_size=12).hexdigest()


def is_private(folder: Path) -> bool:
    """Whether a folder is this user's own, no link, and nobody else may write to it (where the system says so)."""
    about = folder.lstat()
    return not hasattr(os, "getuid") or (about.st_uid == os.getuid() and stat.S_ISDIR(about.st_mode)
                                         and not about.st_mode & (stat.S_IWGRP | stat.S_IWOTH))


@cache
def make_room(place: Path) -> None:
    """Delete folders that nobody used for long; OSError if there is no room left."""
    with tempfile.TemporaryFile(dir=place) as file:
        now = os.fstat(file.fileno()).st_mtime  # by the clock that the folders have
        for folder in place.iterdir():
            if now - folder.stat().st_mtime > UNUSED_TIME:
                shutil.rmtree(folder, ignore_errors=True)
        if shutil.disk_usage(place).free < ROOM:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        file.write(bytes(ROOM // 64))  # which a quota or a limit may forbid


@cache
def folder_of(module: str) -> Path | None:
    """Return the folder of a module's kernels, made if need be; None if there is none that is safe and has room."""
    place = Path(HOST_FOLDER).absolute() if HOST_FOLDER and not os.environ.get("LAUNCHID_CACHE") else cache_folder()
    if place is None or config.DISABLE_JIT or not getattr(sys.modules.get(module), "__file__", None):
        return None
    try:
        folder = place / "kernels" / f"{module}-{digest_of(module)}"
        place.mkdir(parents=True, exist_ok=True)
        for each in (folder.parent, folder):
            each.mkdir(mode=0o700, exist_ok=True)
            if not (is_private(each) and os.access(each, os.W_OK)):
                return None
        os.utime(folder)
        make_room(folder.parent)
        for file in folder.glob("*/*.nb[ci]"):
            if not file.read_bytes().endswith(b"."):  # a pickle's end: a crash of the machine has cut it short
                file.unlink(missing_ok=True)
    except OSError:
        return None
    return folder


@contextlib.contextmanager
def kept_apart(function: Callable[..., Any]) -> Iterator[bool]:
    """A context in which numba's cache folder is that of the function's module; gives whether there is one."""
    folder = folder_of(function.__module__)
    with alone:
        usual = config.CACHE_DIR
        try:
            config.CACHE_DIR = str(folder) if folder else usual
            yield folder is not None
        finally:
            config.CACHE_DIR = usual
