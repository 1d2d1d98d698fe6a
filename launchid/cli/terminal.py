"""The command's output: messages and progress on stderr, data on stdout.  It is the only place that prints."""

import errno
import io
import os
import sys
import time

from sim.errors import InputError, one_line


def say(text: str) -> None:
    """Talk, on stderr: one line, whatever a path or a key holds."""
    print(one_line(text), file=sys.stderr)


def answer(text: str = "", end: str = "\n") -> None:
    """Data, on stdout, all of it: InputError if it has no room for it."""
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
    """A bar of the steps done and what is being done, on a terminal only: one line that is written over."""

    STEPS = 8  # of a diagnosis with one cause

    def __init__(self) -> None:
        self.done = 0

    def __call__(self, text: str) -> None:
        """An empty text clears the line."""
        if sys.stderr.isatty():
            full = min(self.done, self.STEPS)
            sys.stderr.write("\r\x1b[K" + (f"[{'#' * full}{'.' * (self.STEPS - full)}] {text}" if text else ""))
            sys.stderr.flush()
        self.done += 1


class ProgressBar:
    """A counter of what is done: on a terminal one line that is written over, elsewhere a line every ten seconds."""

    WIDTH = 20      # of the bar
    OFTEN = 0.2     # s, between two looks
    LINE = 10.0     # s, between two lines of a file

    def __init__(self, total: int, unit: str) -> None:
        self.total, self.unit = total, unit
        self.done = 0
        self._found: int | None = None  # done when it began, by an earlier run
        self._begun = self._shown = time.monotonic()

    def __call__(self, newly: int) -> None:
        """Count so many more as done, and show it."""
        self.done += newly
        if self._found is None:
            self._found = newly
        now = time.monotonic()
        if sys.stderr.isatty() and now - self._shown >= self.OFTEN:
            self._shown = now
            rate = (self.done - self._found) / (now - self._begun)
            full = self.WIDTH * self.done // self.total
            bar = "#" * full + "." * (self.WIDTH - full)
            sys.stderr.write(f"\r\x1b[K[{bar}] {self.done} of {self.total} {self.unit}, {rate:.0f}/s")
            sys.stderr.flush()
        elif not sys.stderr.isatty() and now - self._shown >= self.LINE and self.done < self.total:
            self._shown = now
            say(f"{self.done} of {self.total} {self.unit}")

    def clear(self) -> None:
        """Nothing is counted any more."""
        if sys.stderr.isatty():
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()


class Closed(io.TextIOBase):
    """A stdout that is not there: only who writes to it fails."""

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
