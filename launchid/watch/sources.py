"""Sources of rows as pieces of bytes: a growing file, a pipe, UDP or TCP on the loopback.

A piece may end anywhere in a line.  b"" says that nothing came for IDLE [s]; None that another stream follows.
"""

import os
import re
import selectors
import socket
import stat
import sys
import time
from collections.abc import Callable, Iterator
from typing import Protocol

from sim.errors import InputError, UsageError
from sim.files import reads

from ..log.log import STANDARD_INPUT, Log, locate_log

LOOPBACK = "127.0.0.1"   # the only address that anything here is bound to
IDLE = 0.05              # s, between looks for something new: as often as a page is told
BYTES_A_READ = 1 << 16   # bytes at most: about a thousand rows, a few milliseconds of the estimator's time
ROWS_A_READ = 1000       # about as much, of a log that is whole
DATAGRAM = 1 << 16       # bytes: longer than any
DATAGRAMS = 256          # in a piece at most
BACKLOG = 1 << 22        # bytes that the system is asked to keep of UDP while the estimator is busy
MOST_SENDERS = 16        # connections that wait to be heard: of more the oldest that says nothing is closed
SILENT = 10.0            # s after which a sender that says nothing gives way to one that does
ARRIVALS = 1024          # connections that the system keeps until they are looked at
KNOWN_BY = 16            # bytes of a first line that tell what it is: no request of HTTP is shorter
# of HTTP, which any page in a browser can send to any port
REQUEST = re.compile(rb"(GET|HEAD|POST|PUT|DELETE|CONNECT|OPTIONS|TRACE|PATCH|PRI) ", re.IGNORECASE)

Pieces = Iterator[bytes | None]
# of select's kinds the one that takes any descriptor and any file, where there is it
Selector = getattr(selectors, "PollSelector", selectors.SelectSelector)


def is_readable(what: int | socket.socket, patience: float) -> bool:
    """Whether a descriptor or socket has bytes to read, now or within `patience` [s]."""
    with Selector() as selector:
        selector.register(what, selectors.EVENT_READ)
        return bool(selector.select(patience))


class Source(Protocol):
    """A stream of a log's bytes; name: what messages call it."""

    name: str

    def pieces(self) -> Pieces:
        """Yield pieces of bytes until the source ends: b"" if nothing came for IDLE [s], None before another stream."""


def open_source(text: str, once: bool, say: Callable[[str], None] = lambda text: None) -> Source:
    """Open FILE, `-` (standard input), udp:PORT or tcp:PORT; UsageError or InputError in one line if that fails.

    once  the source ends: a file with its last row, TCP with its first sender, UDP with an empty datagram
    say   called once with a line if a connection was closed for what it sent (HTTP, or no text)
    """
    kind, _, port = text.partition(":")
    if kind in ("udp", "tcp"):
        bound = _bound(text, kind, port)
        return Udp(bound, once) if kind == "udp" else Tcp(bound, once, say)
    if text == STANDARD_INPUT:
        if sys.stdin is None:
            raise InputError("-: standard input is closed; expected a CSV log there")
        reads(sys.stdin.fileno())
        return Pipe(text, sys.stdin.fileno())
    path = locate_log(text)
    try:
        status = os.stat(path)
        if stat.S_ISFIFO(status.st_mode):
            reads(path)
            return Pipe(text, os.open(path, os.O_RDONLY))
        if not stat.S_ISREG(status.st_mode):
            raise InputError(f"{text}: neither a file nor a pipe; expected a CSV log, udp:PORT or tcp:PORT")
        reads(path)
        return File(text, str(path), once)
    except OSError as error:
        raise InputError(f"{text}: cannot be read ({error.strerror}); expected a CSV log, udp:PORT or "
                         "tcp:PORT") from None


def _bound(text: str, kind: str, port: str) -> socket.socket:
    if not (port.isascii() and port.isdigit() and int(port) < 1 << 16):
        raise UsageError(f"{text}: expected {kind}:PORT with a port of 0 (any free one) to 65535")
    bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM if kind == "udp" else socket.SOCK_STREAM)
    try:
        if kind == "tcp":
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.bind((LOOPBACK, int(port)))
    except OSError as error:
        bound.close()
        raise UsageError(f"{text}: cannot listen there ({error.strerror}); expected a free port, 0 takes any") from None
    return bound


class File:
    """A regular file, followed as `tail -F` does: appended rows, and the new file when it was replaced or cut."""

    def __init__(self, name: str, path: str, once: bool) -> None:
        """Open the file; OSError if that fails."""
        self.name, self._path, self._once = name, path, once
        self._file = open(path, "rb")

    def pieces(self) -> Pieces:
        try:
            while True:
                if piece := self._file.read(BYTES_A_READ):
                    yield piece
                elif self._once:
                    yield b"\n"  # a last line without its end counts, as it does when a whole log is read
                    return
                else:
                    time.sleep(IDLE)
                    yield None if self._turn() else b""
        except OSError as error:
            raise InputError(f"{self.name}: cannot be read ({error.strerror})") from None
        finally:
            self._file.close()

    def _turn(self) -> bool:
        """Open the file that stands at the path now, if it is another or was cut; return whether it was."""
        try:
            status = os.stat(self._path)
            if status.st_size >= self._file.tell() and os.path.samestat(status, os.fstat(self._file.fileno())):
                return False
            another = open(self._path, "rb")
        except OSError:
            return False  # none for the moment: the next one is waited for
        self._file.close()
        self._file = another
        return True


class Whole:
    """A complete log, read from a file of another format, given out as the CSV text of its rows."""

    def __init__(self, log: Log) -> None:
        self.name, self._log = log.path, log

    def pieces(self) -> Pieces:
        """Yield the log as CSV text, ROWS_A_READ rows a piece, each number in the shortest form with the same bits."""
        columns = self._log.measured()
        yield (",".join(columns) + "\n").encode()
        for k in range(0, len(self._log.t), ROWS_A_READ):
            rows = zip(*(x[k:k + ROWS_A_READ].tolist() for x in columns.values()), strict=True)
            yield "".join(",".join(map(repr, row)) + "\n" for row in rows).encode()


class Pipe:
    """Standard input or a FIFO; it ends when its writers have closed it."""

    def __init__(self, name: str, number: int) -> None:
        self.name, self._number = name, number

    def pieces(self) -> Pieces:
        while True:
            if not is_readable(self._number, IDLE):
                yield b""
            elif piece := os.read(self._number, BYTES_A_READ):
                yield piece
            else:
                yield b"\n"
                return


class Udp:
    """A UDP socket; a datagram holds one row, or several lines."""

    def __init__(self, bound: socket.socket, once: bool) -> None:
        self._socket, self._once = bound, once
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BACKLOG)
        bound.setblocking(False)
        self.name = f"udp:{bound.getsockname()[1]}"

    def pieces(self) -> Pieces:
        with self._socket:
            while True:
                is_readable(self._socket, IDLE)
                lines = list(self._waiting())
                yield b"".join(line + b"\n" for line in lines)
                if self._once and b"" in lines:
                    return

    def _waiting(self) -> Iterator[bytes]:
        for _ in range(DATAGRAMS):
            try:
                yield self._socket.recv(DATAGRAM)
            except BlockingIOError:
                return


class Tcp:
    """A TCP socket that reads one sender at a time; the next one follows when it has closed or is SILENT [s] silent.

    A connection is a sender once its first line has begun, and is closed if that is HTTP or no text.  Connections that
    send nothing do not hold up others.
    """

    def __init__(self, bound: socket.socket, once: bool, say: Callable[[str], None] = lambda text: None) -> None:
        self._socket, self._once, self._say = bound, once, say
        bound.listen(ARRIVALS)
        bound.setblocking(False)
        self.name = f"tcp:{bound.getsockname()[1]}"
        self._waiting: list[socket.socket] = []  # by age
        self.refused = 0                         # for what they sent

    def pieces(self) -> Pieces:
        with self._socket:
            while True:
                sender = self._next()
                if sender is None:
                    is_readable(self._socket, IDLE)
                    yield b""
                    continue
                self._waiting.remove(sender)
                with sender:
                    yield from self._sent(sender)
                yield None
                if self._once:
                    return

    def _sent(self, sender: socket.socket) -> Iterator[bytes]:
        heard = time.monotonic()
        while True:
            if is_readable(sender, IDLE):
                try:
                    piece = sender.recv(BYTES_A_READ)
                except OSError:
                    return
                if not piece:
                    return
                heard = time.monotonic()
                yield piece
            elif self._next() is not None and time.monotonic() - heard > SILENT:
                return
            else:
                yield b""

    def _next(self) -> socket.socket | None:
        """Return the oldest connection that has begun a line of text, or None; close those that cannot be senders."""
        self._accept()
        speaking = []
        for sender in [*self._waiting]:
            first = _first_bytes(sender)
            if first and (REQUEST.match(first) or b"\0" in first):
                self._refuse(sender)
            elif first:
                speaking.append(sender)
            elif first is not None:
                self._close(sender)
        while len(self._waiting) > MOST_SENDERS:
            self._close(next((each for each in self._waiting if each not in speaking), self._waiting[-1]))
        return speaking[0] if speaking else None

    def _accept(self) -> None:
        for _ in range(ARRIVALS):
            try:
                self._waiting.append(self._socket.accept()[0])
            except OSError:  # nobody more
                return
            self._waiting[-1].setblocking(False)

    def _refuse(self, sender: socket.socket) -> None:
        self.refused += 1
        if self.refused == 1:
            self._say(f"{self.name}: a connection that sent HTTP, or no text, was closed; expected rows")
        self._close(sender)

    def _close(self, sender: socket.socket) -> None:
        self._waiting.remove(sender)
        sender.close()


def _first_bytes(sender: socket.socket) -> bytes | None:
    """Return the first bytes of a connection, which stay unread, b"" if it has ended, None while they are too few."""
    try:
        first = sender.recv(KNOWN_BY, socket.MSG_PEEK)
    except BlockingIOError:
        return None
    except OSError:
        return b""
    return first if len(first) in (0, KNOWN_BY) or b"\n" in first else None
