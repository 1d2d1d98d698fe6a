"""The command's output: messages and progress on stderr, data on stdout.  It is the only place that prints."""

import contextlib
import errno
import io
import os
import sys
import time
from collections.abc import Iterator

from sim.errors import InputError, one_line

from .. import progress


def say(text: str) -> None:
    """Talk, on stderr: one line, whatever a path or a key holds."""
    clear_progress()
    print(one_line(text), file=sys.stderr)


def answer(text: str = "", end: str = "\n") -> None:
    """Data, on stdout, all of it: InputError if it has no room for it."""
    clear_progress()
    try:
        print(text, end=end, flush=True)
    except BrokenPipeError:
        raise
    except OSError as error:
        leave_stdout()
        raise InputError(f"standard output: cannot be written ({error.strerror})") from None


def speak_utf8() -> None:
    """The same bytes whatever the locale: UTF-8, and an escape for what is no character (a byte of a file's name)."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(encoding="utf-8", errors="backslashreplace")


class Progress:
    """What is being done and how far it is: on a terminal one line that is written over, elsewhere a line every ten
    seconds."""

    WIDTH = 20      # of the bar
    OFTEN = 0.2     # s, between two looks at the same work
    LINE = 10.0     # s, between two lines of a file

    def __init__(self) -> None:
        self._process = os.getpid()
        self._work, self._found = "", 0  # what is being done; how much of it was when it began
        self._begun = self._shown = self._lined = time.monotonic()
        self._is_drawn = False

    def __call__(self, what: str, done: int = 0, total: int = 0) -> None:
        """Note that `done` of `total` (0: not known) are; another process than the one that began says nothing."""
        if os.getpid() != self._process:
            return
        now = time.monotonic()
        is_new = what != self._work
        if is_new:
            self._work, self._found, self._begun = what, done, now
        if not sys.stderr.isatty():
            if now - self._lined >= self.LINE and (done or not total):  # that nothing is done says nothing
                self._lined = now
                say(f"launchid: {what}" + (f": {done} of {total}" if total else " ..."))
        elif is_new or now - self._shown >= self.OFTEN:
            self._shown, self._is_drawn = now, True
            bar, count = "", " ..."
            if total:
                full = self.WIDTH * done // total
                bar = f"[{'#' * full}{'.' * (self.WIDTH - full)}] "
                count = f": {done} of {total}"
                if now > self._begun and done > self._found:
                    count += f", {self._seconds_left(now, done, total):.0f} s left"
            sys.stderr.write(f"\r\x1b[K{bar}{one_line(what)}{count}")
            sys.stderr.flush()

    def _seconds_left(self, now: float, done: int, total: int) -> float:
        return (now - self._begun) * (total - done) / (done - self._found)

    def clear(self) -> None:
        """Take the line off a terminal: something else is written."""
        if self._is_drawn and os.getpid() == self._process:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()
            self._is_drawn = False


@contextlib.contextmanager
def progress_shown(is_quiet: bool) -> Iterator[None]:
    """Show how far the work is while it is done, unless quiet."""
    before = list(progress.listeners)
    if not is_quiet:
        progress.listeners.append(Progress())
    try:
        yield
    finally:
        clear_progress()
        progress.listeners[:] = before


def shown_counter(total: int, what: str) -> progress.Counter:
    """Return a counter whose progress is shown from now on."""
    progress.listeners[:] = [Progress()]
    return progress.Counter(total, what)


def clear_progress() -> None:
    """Take the line of progress off a terminal."""
    for listener in progress.listeners:
        if isinstance(listener, Progress):
            listener.clear()


class Closed(io.TextIOBase):
    """A stand-in for a closed stdout: writing raises OSError."""

    def write(self, text: str) -> int:
        raise OSError(errno.EBADF, "it is closed")


class Unheard(io.TextIOBase):
    """A stderr that is not there: talk is lost."""

    def write(self, text: str) -> int:
        return len(text)


def open_streams() -> None:
    """A closed stdout or stderr is none: no file that is opened takes its number, and talk does not go to stdout."""
    if sys.stdout is not None and sys.stderr is not None:
        return
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number, which is this
    sys.stdout = sys.stdout or Closed()
    sys.stderr = sys.stderr or Unheard()


def leave_stdout() -> None:
    """Nothing more is written to it, at the interpreter's end either."""
    if not isinstance(sys.stdout, Closed):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
