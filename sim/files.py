"""Output files: whole or not at all, and never in the place of what is no file.

A regular file is written beside, under a hidden name, and takes the place of the old one when it is whole: with the
old one's mode, and behind a symbolic link, which stays.  A device, a FIFO or a socket, and the file that stdout or
stderr is, are written through.  What a killed run left under a hidden name goes at the next run into the same folder.

A file is refused (InputError, one line) that may not be written by its mode, whoever asks, and one that the command
reads: within `inputs_spared`, what `reads` has named.
"""

import contextlib
import os
import re
import secrets
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterable, Iterator
from contextvars import ContextVar
from pathlib import Path

from .errors import InputError, UsageError

try:
    import fcntl
except ImportError:  # not a POSIX system: no lock says whose a hidden file is, so none is removed
    fcntl = None  # type: ignore[assignment]

NAME_CHARACTERS = 40  # characters of a file's name in its hidden one's, so that this is not too long where that is
HIDDEN_NAME = re.compile(r"\..+\.[0-9a-f]{16}\.launchid", re.DOTALL)  # no name that anybody else gives
WRITABLE = 0o222     # mode bits; root may write without them, and is refused all the same
NEW_MODE = 0o666     # of a new file, less the umask

_Identity = tuple[int, int]
_inputs: ContextVar[set[_Identity] | None] = ContextVar("inputs", default=None)


@contextlib.contextmanager
def inputs_spared() -> Iterator[None]:
    """Return a context in which `check_output` refuses files named to `reads`, the command's inputs."""
    token = _inputs.set(set())
    try:
        yield
    finally:
        _inputs.reset(token)


def reads(path: str | Path | int) -> None:
    """Note a file (path or descriptor) as an input, within `inputs_spared`; it is refused as an output then."""
    known = _inputs.get()
    if known is not None:
        with contextlib.suppress(OSError, ValueError):
            status = os.stat(path)
            known.add((status.st_dev, status.st_ino))


def is_read(path: str | Path) -> bool:
    """Whether the file at `path` was named to `reads`."""
    return _is_input(os.stat(path))


def _is_input(status: os.stat_result) -> bool:
    return (status.st_dev, status.st_ino) in (_inputs.get() or ())


def as_path(path: object) -> Path:
    """Return `path` as a Path; UsageError if it is no path or holds a NUL."""
    if not isinstance(path, (str, os.PathLike)) or not isinstance(os.fspath(path), str):
        raise UsageError(f"expected a path; found {type(path).__name__}")
    if "\0" in os.fspath(path):
        raise UsageError(f"{path}: no path holds a NUL")
    return Path(path)


def check_output(path: str | Path) -> os.stat_result | None:
    """Return the status of the file at an output's path, None if there is none; InputError if not writable."""
    try:
        status = os.stat(as_path(path))
    except FileNotFoundError:
        _check_place(path)
        return None
    except OSError as error:
        raise _unwritable(path, error) from None
    if stat.S_ISDIR(status.st_mode):
        raise InputError(f"{path}: cannot be written (it is a folder)")
    if stat.S_ISREG(status.st_mode):
        if not status.st_mode & WRITABLE or not os.access(path, os.W_OK):
            raise InputError(f"{path}: cannot be written (it is read-only)")
        if _stream(status) is None:
            _check_place(path)
    if stat.S_ISREG(status.st_mode) or stat.S_ISFIFO(status.st_mode):
        if _is_input(status):
            raise InputError(f"{path}: cannot be written (it is this command's input); expected another name")
    return status


def _check_place(path: str | Path) -> None:
    """Raise InputError unless the path's folder takes a new file, also in the place of an old one."""
    place = Path(os.path.realpath(path)).parent
    if not place.is_dir():
        raise InputError(f"{path}: cannot be written (no such folder)")
    if not os.access(place, os.W_OK | os.X_OK):
        raise InputError(f"{path}: cannot be written (no permission in its folder)")


@contextlib.contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """Give a temporary path in this context; its file becomes the output `path` when the block ends well, else it is
    removed."""
    path = as_path(path)
    status = check_output(path)
    try:
        replaced = status is None or (stat.S_ISREG(status.st_mode) and _stream(status) is None)
        target = Path(os.path.realpath(path)) if replaced else None
        place = target or Path(tempfile.gettempdir()) / path.name
        _remove_abandoned(place.parent)
        handle, temporary = _claimed(place)
    except OSError as error:
        raise _unwritable(path, error) from None
    try:
        yield temporary
        if target is None:
            _write_through(temporary, path)
        else:
            os.chmod(temporary, NEW_MODE & ~_umask() if status is None else stat.S_IMODE(status.st_mode))
            os.replace(temporary, target)
    except OSError as error:
        raise _unwritable(path, error) from None
    finally:
        temporary.unlink(missing_ok=True)
        if handle is not None:
            os.close(handle)


def _unwritable(path: str | Path, error: OSError) -> InputError:
    return InputError(f"{path}: cannot be written ({error.strerror})")


def _stream(status: os.stat_result) -> int | None:
    """Return the descriptor of stdout or stderr if `status` is that file's; else None."""
    for number in (1, 2):
        with contextlib.suppress(OSError):
            if os.path.samestat(os.fstat(number), status):
                return number
    return None


def _write_through(temporary: Path, path: Path) -> None:
    """Copy to a file that must not be replaced: to stdout where it has come to, elsewhere as a shell's `>>` does."""
    number = _stream(os.stat(path))
    sys.stdout.flush()
    handle = os.open(path, os.O_WRONLY | os.O_APPEND) if number is None else os.dup(number)
    with temporary.open("rb") as source, os.fdopen(handle, "wb", buffering=0) as file:
        shutil.copyfileobj(source, file)


# ---- hidden files


def _claimed(target: Path) -> tuple[int | None, Path]:
    """Return (descriptor, path) of a new hidden file; the descriptor holds its lock while its process lives."""
    while True:
        path = target.parent / f".{target.name[:NAME_CHARACTERS]}.{secrets.token_hex(8)}.launchid"
        try:
            handle = os.open(path, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o600)
            if fcntl is None:
                os.close(handle)
                return None, path
            with contextlib.suppress(OSError):  # a file system without locks
                fcntl.flock(handle, fcntl.LOCK_EX)
            if path.exists():  # else it was taken for abandoned before it was locked
                return handle, path
            os.close(handle)
        except KeyboardInterrupt:
            path.unlink(missing_ok=True)
            raise


def _remove_abandoned(folder: Path) -> None:
    """Remove the hidden files in this folder, of whatever output, that no living process holds."""
    for path in [entry for entry in folder.iterdir() if HIDDEN_NAME.fullmatch(entry.name)] if fcntl else ():
        with contextlib.suppress(OSError):  # locked, or of another user
            handle = os.open(path, os.O_RDWR | os.O_NOFOLLOW)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                path.unlink()
            finally:
                os.close(handle)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


# ---- what is written


def check_folder(path: str | Path) -> None:
    """Raise InputError unless the folder exists or can be made: before anything that goes into it is computed."""
    place = as_path(path).absolute()
    there = next(part for part in (place, *place.parents) if os.path.lexists(part))
    if not there.is_dir():
        raise InputError(f"{path}: cannot be made a folder ({there} is none)")
    if not os.access(there, os.W_OK | os.X_OK):
        raise InputError(f"{path}: cannot be written (no permission in {there})")


def make_folder(path: str | Path) -> Path:
    """Return the folder, made with its parents if it is not there; InputError if it cannot be made."""
    folder = as_path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be made a folder ({error.strerror})") from None
    return folder


def write_text(path: str | Path, lines: Iterable[str]) -> None:
    """Write the lines (each with its newline) as a UTF-8 text file, whole or not at all."""
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as file:
        file.writelines(lines)


def remove(path: str | Path) -> None:
    """Remove an earlier output file, if there is one; InputError if it cannot be written."""
    if os.path.isfile(path):
        check_output(path)
        Path(path).unlink()
