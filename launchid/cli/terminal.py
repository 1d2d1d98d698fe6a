"""Output of the command: messages and progress on stderr, data on stdout.  Nothing else prints."""

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
    """Print a message on stderr as one line; characters that cannot be printed are escaped."""
    clear_progress()
    print(one_line(text), file=sys.stderr)


def answer(text: str = "", end: str = "\n") -> None:
    """Print data on stdout; InputError if it cannot be written (a full disk), BrokenPipeError if nobody reads it."""
    clear_progress()
    try:
        print(text, end=end, flush=True)
    except BrokenPipeError:
        raise
    except OSError as error:
        leave_stdout()
        raise InputError(f"standard output: cannot be written ({error.strerror})") from None


def speak_utf8() -> None:
    """Set stdout and stderr to UTF-8 whatever the locale; what is no character (a byte of a file's name) is escaped."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(encoding="utf-8", errors="backslashreplace")


class Progress:
    """Listener that shows work and share done: on a terminal one line written over, else a line every LINE [s]."""

    WIDTH = 20      # of the bar
    OFTEN = 0.2     # s, between two looks at the same work
    LINE = 10.0     # s, between two lines of a file

    def __init__(self) -> None:
        self._process = os.getpid()
        self._work, self._found = "", 0  # what is being done; how much of it was when it began
        self._begun = self._shown = self._lined = time.monotonic()
        self._is_drawn = False

    def __call__(self, what: str, done: int = 0, total: int = 0) -> None:
        """Show that `done` of `total` (0: not known) are done; a forked process shows nothing."""
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
        """Erase the progress line of a terminal, so that something else can be printed."""
        if self._is_drawn and os.getpid() == self._process:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()
            self._is_drawn = False


@contextlib.contextmanager
def progress_shown(is_quiet: bool) -> Iterator[None]:
    """Show the progress of the work in this context on stderr, unless quiet."""
    before = list(progress.listeners)
    if not is_quiet:
        progress.listeners.append(Progress())
    try:
        yield
    finally:
        clear_progress()
        progress.listeners[:] = before


def shown_counter(total: int, what: str) -> progress.Counter:
    """Return a counter of `total` items that shows its progress on stderr from now on."""
    progress.listeners[:] = [Progress()]
    return progress.Counter(total, what)


def clear_progress() -> None:
    """Erase the progress line of a terminal, if there is one."""
    for listener in progress.listeners:
        if isinstance(listener, Progress):
            listener.clear()


class Closed(io.TextIOBase):
    """A stand-in for a closed stdout: writing raises OSError."""

    def write(self, text: str) -> int:
        raise OSError(errno.EBADF, "it is closed")


class Unheard(io.TextIOBase):
    """A stand-in for a closed stderr: what is written is lost."""

    def write(self, text: str) -> int:
        return len(text)


def open_streams() -> None:
    """Replace a closed stdout or stderr by a stand-in, and occupy descriptors 0 to 2, so that no file gets them."""
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
    """Redirect stdout to the null device: nothing more is written to it, at the interpreter's end either."""
    if not isinstance(sys.stdout, Closed):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
