"""Serve the page and its messages on the loopback, in threads that only read `live`.

    /        the page
    /events  server-sent events: everything at first, then what is new, at most 20 times a second
    /state   everything once, as JSON

A browser that does not read is told everything it missed in one message when it does, and is let go after
BROWSER_TIMEOUT.

Each connection has a thread, MOST_CONNECTIONS at most: a new one is served, and the oldest is closed for it.  Pages of
other origins get status 403.
"""

import base64
import contextlib
import hashlib
import io
import json
import re
import socket
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from sim.errors import UsageError

from ..report.inline import inlined
from .live import Live, message
from .sources import ARRIVALS, LOOPBACK

FRAME = 0.05        # s between messages at least: 20 a second
ALIVE = 2.0         # s without news after which a page is told that there is none
BROWSER_TIMEOUT = 10.0  # s that a browser may leave unread, or a request unfinished
MOST_PAGES = 16     # at a time that are told
MOST_CONNECTIONS = 64  # at a time, those pages among them
FAREWELL = 1.0      # s that pages are given to hear of the end

LIVE_PAGE = inlined((Path(__file__).parent / "page.html").read_text(encoding="utf-8")).encode()


def _hash(tag: str) -> str:
    """Return the hash of the page's one <script> or <style> for the Content-Security-Policy: no other is run."""
    (inside,) = re.findall(rb"<%b>(.*?)</%b>" % (tag.encode(), tag.encode()), LIVE_PAGE, re.DOTALL)
    return f"'sha256-{base64.b64encode(hashlib.sha256(inside).digest()).decode()}'"


HEADERS = {
    "Cache-Control": "no-store", "X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer",
    "Content-Security-Policy": f"default-src 'none'; script-src {_hash('script')}; style-src {_hash('style')}; "
                               "connect-src 'self'; img-src data:; base-uri 'none'; form-action 'none'; "
                               "frame-ancestors 'none'"}


class Server(ThreadingHTTPServer):
    """HTTP server of a `Live` state on the loopback, which serves from its creation until `end`."""

    daemon_threads = True
    block_on_close = False
    request_queue_size = ARRIVALS
    _serves = False

    def __init__(self, live: Live, port: int) -> None:
        """Listen on the port (0: any free one) and start serving; UsageError if it is taken."""
        try:
            super().__init__((LOOPBACK, port), Handler)
        except OSError as error:
            raise UsageError(f"--http {port}: cannot listen there ({error.strerror}); expected a free port") from None
        self.live = live
        self.open: dict[socket.socket, None] = {}     # connections by age
        self.telling: dict[socket.socket, None] = {}  # of these the pages that are told, by age
        self._lock = threading.Lock()                 # of the two
        self._room = threading.Semaphore(MOST_CONNECTIONS)
        self._serves = True
        threading.Thread(target=self.serve_forever, args=(FRAME,), daemon=True).start()

    @property
    def url(self) -> str:
        return f"http://{LOOPBACK}:{self.server_address[1]}/"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore an error of a connection: a browser may leave at any time."""

    def process_request(self, request: Any, client_address: Any) -> None:
        """Serve a connection in a new thread; if MOST_CONNECTIONS are open, close the oldest without a page first."""
        if not self._room.acquire(blocking=False):
            with self._lock:
                oldest = next((each for each in self.open if each not in self.telling), request)
            with contextlib.suppress(OSError):
                oldest.shutdown(socket.SHUT_RDWR)
            if not self._room.acquire(timeout=FAREWELL):
                request.close()
                return
        with self._lock:
            self.open[request] = None
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        """Close a connection and make room for another."""
        super().shutdown_request(request)
        with self._lock:
            del self.open[request]
        self._room.release()

    def admit(self, page: socket.socket) -> None:
        """Add a page to those that receive events; of more than MOST_PAGES the oldest receives no more."""
        with self._lock:
            while len(self.telling) >= MOST_PAGES:
                del self.telling[next(iter(self.telling))]
            self.telling[page] = None

    def leave(self, page: socket.socket) -> None:
        """Take a page from those that receive events."""
        with self._lock:
            self.telling.pop(page, None)

    def end(self) -> None:
        """Stop the server once connected pages have received the last state, after FAREWELL [s] at most."""
        until = time.monotonic() + FAREWELL
        while self.telling and time.monotonic() < until:
            time.sleep(0.5 * FRAME)
        self.server_close()

    def server_close(self) -> None:
        """Stop serving, if it began, and close the socket: a loop over a closed one would never rest."""
        if self._serves:
            self.shutdown()
        super().server_close()


class RequestLines(io.BufferedReader):
    """What a connection asks; it `is_whole` once the blank line after its headers was the last one read."""

    is_whole = False

    def readline(self, size: int | None = -1, /) -> bytes:
        """Return the next line, empty at the end of what comes."""
        line = super().readline(-1 if size is None else size)
        self.is_whole = line in (b"\r\n", b"\n")
        return line


class Handler(BaseHTTPRequestHandler):
    """Answer to one HTTP request for /, /events or /state; status 403 for pages of other origins."""

    server: Server
    server_version, sys_version = "launchid", ""
    timeout = BROWSER_TIMEOUT

    def setup(self) -> None:
        """Read the request by lines that know whether it is whole."""
        super().setup()
        self.rfile: RequestLines = RequestLines(self.rfile.detach())

    def parse_request(self) -> bool:
        """Whether there is a request to answer: one that breaks off within its headers is none, and takes the place
        of no page."""
        return super().parse_request() and self.rfile.is_whole

    def log_message(self, format: str, *args: Any) -> None:
        """Print nothing about a request."""

    def do_HEAD(self) -> None:
        self._answer(with_body=False)

    def do_GET(self) -> None:
        self._answer(with_body=True)

    def _answer(self, with_body: bool) -> None:
        path = self.path.partition("?")[0]
        if not self._is_ours(path):
            self._whole(403, "text/plain; charset=utf-8", b"asked by another name, or by another page\n", with_body)
        elif path == "/":
            self._whole(200, "text/html; charset=utf-8", LIVE_PAGE, with_body)
        elif path == "/state":
            self._whole(200, "application/json", _json(message(self.server.live, None)[0]), with_body)
        elif path == "/events":
            self._events(with_body)
        else:
            self._whole(404, "text/plain; charset=utf-8", b"expected /, /events or /state\n", with_body)

    def _is_ours(self, path: str) -> bool:
        """Whether a request names this machine as host and comes from no page of another origin, whose name may have
        been resolved to this address; a link to the page may stand anywhere."""
        names = (LOOPBACK, "localhost")
        host, origin = self.headers.get("Host", ""), self.headers.get("Origin")
        if (host.rpartition(":")[0] or host) not in names:
            return False
        if origin is not None and origin not in [f"http://{name}:{self.server.server_address[1]}" for name in names]:
            return False
        return path == "/" or self.headers.get("Sec-Fetch-Site", "none") in ("none", "same-origin")

    def _head(self, status: int, kind: str, **more: str) -> None:
        self.send_response(status)
        for name, value in {"Content-Type": kind, **HEADERS, **more}.items():
            self.send_header(name, value)
        self.end_headers()

    def _whole(self, status: int, kind: str, body: bytes, with_body: bool) -> None:
        self._head(status, kind, **{"Content-Length": str(len(body))})
        if with_body:
            self.wfile.write(body)

    def _events(self, with_body: bool) -> None:
        self.server.admit(self.connection)
        try:
            self._head(200, "text/event-stream")
            if with_body:
                self._tell()
        finally:
            self.server.leave(self.connection)

    def _tell(self) -> None:
        live, seen, revision, last = self.server.live, None, -1, 0.0
        self.wfile.write(b"retry: 1000\n\n")
        while self.connection in self.server.telling:
            clock = time.monotonic()
            if revision != live.revision or clock - last > ALIVE:
                revision = live.revision  # before it is read: what comes meanwhile is told again
                news, seen = message(live, seen)
                self.wfile.write(b"data: " + _json(news) + b"\n\n")
                last = clock
                if news["now"]["state"] == "ended":
                    return
            time.sleep(FRAME)
        self.wfile.write(b"event: replaced\ndata: {}\n\n")


def _json(content: dict[str, Any]) -> bytes:
    """Return the message as JSON, with `idle` [s] since the last row in place of this machine's clock."""
    now = {name: value for name, value in content["now"].items() if name != "clock"}
    if "clock" in content["now"]:
        now["idle"] = round(time.monotonic() - content["now"]["clock"], 1)
    return json.dumps(content | {"now": now}, separators=(",", ":"), allow_nan=False).encode()
