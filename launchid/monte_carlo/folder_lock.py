"""A folder that one run at a time may write into.

The lock is the system's, on one file in the folder: however a run ends, it holds nothing afterwards, and the file that
a killed run left is taken over.  Where the file system has no locks there is none.
"""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from sim.errors import InputError

try:
    import fcntl
except ImportError:  # not a POSIX system
    fcntl = None  # type: ignore[assignment]
    import msvcrt

LOCK = ".launchid.lock"
_held = set[int]()  # descriptors: a process that is forked meanwhile lets go of them


def _let_go() -> None:
    """Close the locks in a forked worker, which may outlive a run that is killed: the lock ends with the run."""
    while _held:
        os.close(_held.pop())


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_let_go)


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """A context in which the folder is this run's alone; InputError if it is another's."""
    handle = None
    while handle is None:
        handle = _claimed(folder)
    _held.add(handle)
    try:
        yield
    finally:
        with contextlib.suppress(OSError):  # while it is locked: the next run's is another
            os.unlink(folder / LOCK)
        _held.discard(handle)
        os.close(handle)


def _claimed(folder: Path) -> int | None:
    """A descriptor that holds the lock; None if the run that had it has just taken the file away."""
    path = folder / LOCK
    try:
        handle = os.open(path, os.O_CREAT | os.O_RDWR | getattr(os, "O_NOFOLLOW", 0), 0o666)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror})") from None
    try:
        _lock(handle)
        if os.path.samestat(os.fstat(handle), os.stat(path)):
            return handle
    except FileNotFoundError:
        pass
    except (BlockingIOError, PermissionError):
        os.close(handle)
        raise InputError(f"{folder}: another run is writing into this folder; expected its end, or another folder"
                         ) from None
    os.close(handle)
    return None


def _lock(handle: int) -> None:
    """BlockingIOError, of some systems PermissionError, if another run has it."""
    if fcntl is None:
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        return
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError:  # a file system without locks
        return
