"""The live page under attack: whatever comes to its ports, it ends by no traceback, threads, memory and talk are
bounded, and what it shows of the sound rows is what it would show without."""

import contextlib
import http.client
import itertools
import math
import resource
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from test_watch import Listener, Session, asked, port_of

from launchid.watch import sources
from launchid.watch.follower import MOST_WAITING, WINDOW_ROWS, Follower
from launchid.watch.last_rows import MOST_CHECKED
from launchid.watch.lines import LONGEST_LINE, LONGEST_SAID, MOST_MESSAGES, Lines
from launchid.watch.live import Live
from launchid.watch.rate import PERIOD_ROWS
from launchid.watch.server import MOST_CONNECTIONS, MOST_PAGES, Server
from launchid.watch.sources import MOST_SENDERS, open_source
from sim.flight import fly
from sim.nominal import Nominal, load_nominal

SECONDS = 3.0
A6 = 2.0            # of `constant`
FEW_THREADS = 8     # of this process, beside those of connections
HEADER = b"t,theta,theta_dot,beta,beta_cmd\n"


@pytest.fixture(scope="module")
def nominal() -> Nominal:
    return load_nominal("constant")


@pytest.fixture(scope="module")
def rows(nominal) -> list[bytes]:
    """Sound rows, without their header."""
    flight = itertools.islice(fly(nominal, seed=3), round(SECONDS / 0.01))
    return [b",".join(repr(float(x)).encode() for x in (s.t, s.theta, s.theta_dot, s.beta, s.beta_cmd)) + b"\n"
            for s in flight]


def followed(nominal: Nominal, *pieces: bytes) -> Follower:
    """The follower of these pieces, at their end."""
    follower, lines = Follower("udp:1", nominal, window=1.0), Lines("udp:1", False, lambda text: None)
    for piece in pieces:
        for log in lines.logs(piece):
            follower.take(log)
    follower.end()
    follower.tick("ended", lines.malformed, lines.last)
    return follower


@pytest.fixture(scope="module")
def quiet(nominal, rows) -> dict:
    """The last tracked estimate without any attack."""
    return followed(nominal, HEADER, *rows).live.now["tracked"]


def is_right(now: dict, quiet: dict) -> bool:
    """The truth is within its interval, which is no wider than of a flight some rows shorter."""
    tracked = now["tracked"]
    return (tracked["valid"] and abs(tracked["a6"] - A6) < 4.0 * tracked["a6_std"]
            and tracked["a6_std"] < 1.3 * quiet["a6_std"] and abs(tracked["k1"] - quiet["k1"]) < tracked["k1_std"])


@pytest.fixture
def many_descriptors() -> Iterator[None]:
    """The limit of open files raised to what an attack needs on both of its ends."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard != resource.RLIM_INFINITY and hard < 6000:
        pytest.skip("too few descriptors on this machine")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, 6000), hard))
    yield
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@contextlib.contextmanager
def connections(port: int, n: int, first: bytes = b"") -> Iterator[list[socket.socket]]:
    """The connections, each of which sends this and no more."""
    made = []
    try:
        for _ in range(n):
            made.append(socket.create_connection(("127.0.0.1", port), timeout=20.0))
            if first:
                with contextlib.suppress(ConnectionError):
                    made[-1].sendall(first)
        yield made
    finally:
        for each in made:
            each.close()


def send(port: int, *what: bytes) -> None:
    with socket.create_connection(("127.0.0.1", port)) as sender:
        for each in what:
            sender.sendall(each)


# ---- connections, threads


def test_silent_connections_to_both_ports(nominal, rows, quiet, many_descriptors, monkeypatch):
    """1,300 to the page, 300 to the rows' port while the rows come by it: every row is taken, and the page answers."""
    source = open_source("tcp:0", once=False)
    session = Session(source, nominal)
    before = threading.active_count()
    with connections(session.port, 1300), connections(port_of(source), 300) as held:
        assert max(each.fileno() for each in held) > 1024, "beyond what select takes"
        assert threading.active_count() <= before + MOST_CONNECTIONS + FEW_THREADS
        send(port_of(source), HEADER, *rows)
        session.until(lambda: session.state()["now"].get("rows") == len(rows))
        session.until(lambda: session.state()["now"]["windows"] == SECONDS)
        page = Listener(session.port)
        session.until(lambda: bool(page.last))
        tracked = session.state()["now"]["tracked"]
        assert is_right({"tracked": tracked}, quiet) and page.last["now"]["rows"] == len(rows)
        source._once = True
        send(port_of(source), rows[-1])
        assert session.result().report["rows"] == {"read": len(rows) + 1, "malformed": 0}
        page.end()
    assert threading.active_count() <= before + MOST_CONNECTIONS


@pytest.mark.parametrize(("n", "first"), [
    (150, b"GET /events HTTP/1.0\r\nHost: 127.0.0.1\r\n"),             # that do not end
    (150, b"GET /events HTTP/1.0\r\nHost: 127.0.0.1\r\n\r\n"),         # that are never read
    (150, b"GET / HTTP/1.0\r\nHost: 127.0.0.1\r\n\r\n"), (150, b"\0"), (150, b"X" * 70_000)])
def test_requests_that_hold_make_no_more_threads_than_there_may_be(n, first):
    server = Server(Live({"source": "x"}), 0)
    try:
        early = Listener(server.server_address[1])
        before = threading.active_count()
        with connections(server.server_address[1], n, first):
            assert threading.active_count() <= before + MOST_CONNECTIONS + FEW_THREADS
            assert len(server.open) <= MOST_CONNECTIONS and len(server.telling) <= MOST_PAGES
            page = Listener(server.server_address[1])
            Session.until(lambda: bool(page.last))
            assert page.last["head"] == {"source": "x"}, "a new page is told"
            assert asked(server.server_address[1], "/state")[0] == 200
        server.live.now = {"state": "ended"}
        server.live.revision += 1
        page.end()
        early.end()
        pages = b"/events" in first and first.endswith(b"\r\n\r\n")
        assert (early.last["now"]["state"] == "ended") != pages, "a page stays, but for newer pages"
        Session.until(lambda: not server.open)
        assert server._room._value == MOST_CONNECTIONS, "every connection's room is free again"
    finally:
        server.end()


def test_a_request_that_breaks_off_takes_no_place_of_a_page():
    """Sixteen requests for events that end within their headers: the page that was there is told of the end."""
    server = Server(Live({"source": "x"}), 0)
    try:
        page = Listener(server.server_address[1])
        Session.until(lambda: bool(page.last))
        for _ in range(MOST_PAGES):
            with socket.create_connection(("127.0.0.1", server.server_address[1]), timeout=20.0) as broken:
                broken.sendall(b"GET /events HTTP/1.0\r\nHost: 127.0.0.1\r\n")
                broken.shutdown(socket.SHUT_WR)
                assert broken.recv(1) == b"", "no answer"
        server.live.now = {"state": "ended"}
        server.live.revision += 1
        page.end()
        assert page.last["now"]["state"] == "ended"
    finally:
        server.end()


# ---- rows that come first


def stamped(stamps: list[float]) -> bytes:
    return b"".join(b"%r,0.001,0,0.001,0\n" % t for t in stamps)


FIRST: dict[str, bytes] = {
    "equal": stamped([7.0] * 64), "zero": stamped([0.0] * 640), "NaN": stamped([math.nan] * 200),
    "infinite": stamped([math.inf] * 70), "1e300": stamped([1e300 * (-1) ** k for k in range(64)]),
    "the largest number and its opposite": stamped([sys.float_info.max * (-1) ** k for k in range(200)]),
    "backward": stamped([100.0 - k for k in range(64)]), "a microsecond apart": stamped([k * 1e-6 for k in range(64)]),
    "a nanosecond apart": stamped([k * 1e-9 for k in range(200)]),
    "the least apart": stamped([k * 5e-324 for k in range(64)]),
    "a second apart": stamped([1e5 + k for k in range(64)]), "a year apart": stamped([k * 3e7 for k in range(640)]),
    "at half of the rate": stamped([-50.0 + 0.02 * k for k in range(64)]),
    "at ten times the rate": stamped([-50.0 + 0.001 * k for k in range(128)]),
    "anywhere": stamped(np.random.default_rng(1).uniform(-1e9, 1e9, 200).tolist()),
    "of every kind": stamped([t for k in range(40) for t in (math.nan, 1e300, 5.0, 5.0, -1e18, 0.001 * k)]),
    "no theta": b"0.01,,,,\n0.02,,,,\n" * 100, "one alone": stamped([3.0]), "63": stamped([0.5 * k for k in range(63)]),
    "under another header": b"theta,beta,t\n0,0,0\n" + HEADER,
    "under a header of more": b"t,theta,beta,gamma\n0,0,0,0\n" + HEADER,
    "under twenty headers": b"".join(b"t,theta,beta,x%d\n0,0,0,0\n" % k for k in range(20)) + HEADER,
    "of a header of nothing": b"t\n0\n" * 10 + HEADER, "no row": b"\xff\0\n" * 100,
}


def test_it_begins_whatever_came_before(nominal, rows, quiet):
    """The rate is that of the sound rows, ten of which come at once, and the tracked estimate right."""
    pieces = [b"".join(rows[k:k + 10]) for k in range(0, len(rows), 10)]
    for name, first in FIRST.items():
        follower = followed(nominal, HEADER, first, *pieces)
        assert follower.estimator.config.sample_period == pytest.approx(0.01, rel=1e-6), name
        assert is_right(follower.live.now, quiet), (name, follower.live.now, quiet)


def test_rows_that_say_no_rate_take_no_memory_and_no_time(nominal):
    follower, lines = Follower("udp:1", nominal, window=100.0), Lines("udp:1", False, lambda text: None)
    assert list(lines.logs(HEADER)) == []
    for row, alone in ((b"nan,0,0,0,0\n", MOST_WAITING + 100), (b"1,0,0,0,0\n", 100)):
        for piece in [row] * alone + [row * 500] * 100:
            for log in lines.logs(piece):
                follower.take(log)
        assert len(follower._waiting) <= MOST_WAITING and follower._last_rows.count <= MOST_CHECKED + 500
    for log in lines.logs(stamped([k * 1e-6 for k in range(640)])):
        follower.take(log)
    assert follower.estimator is None and sum(len(log.t) for log in follower._waiting) < PERIOD_ROWS
    (note,) = follower._notes
    assert f"at most {WINDOW_ROWS} rows" in note and "--period" in note


# ---- what is said


def talk(pieces: Callable[[Lines], None]) -> tuple[Lines, list[str]]:
    said: list[str] = []
    lines = Lines("tcp:1", False, said.append)
    pieces(lines)
    return lines, said


def test_what_a_sender_makes_it_say_is_bounded_and_counted(nominal):
    def read(lines: Lines, data: bytes) -> None:
        for _ in lines.logs(data):
            pass

    def others(lines: Lines) -> None:
        for k in range(2000):
            lines.begin_anew()
            read(lines, b"0,0,0,0\n")
            lines.begin_anew()
            read(lines, b"t,theta,beta,%d\n0,0" % k)

    long = ",".join(f"foreign_{k}" for k in range(100)).encode()
    attacks: dict[str, tuple[Callable[[Lines], None], int]] = {
        "2,000 foreign headers": (lambda lines: read(lines, (b"t,theta,beta," + long + b"\n") * 2000), 0),
        "10,000 unreadable rows": (lambda lines: read(lines, b"high\n" * 10_000), 10_000),
        "100 rows of 60 kB": (lambda lines: read(lines, (b"x" * (LONGEST_LINE - 1000) + b"\n") * 100), 100),
        "20 lines of 300 kB": (lambda lines: read(lines, (b"," * 300_000 + b"\n") * 20), 20),
        "2,000 senders that are cut short": (others, 2000 - 1),
        "headers that cannot be": (lambda lines: read(lines, b"t,theta,theta," + long + b"\nt," + long + b"\n"), 2),
    }
    for name, (attack, malformed) in attacks.items():
        lines, said = talk(attack)
        assert lines.malformed == malformed, name
        assert len(said) <= MOST_MESSAGES + 1 and max(map(len, said)) <= LONGEST_SAID + 60, name
        assert len(lines.last) <= LONGEST_SAID, name


def test_foreign_names_and_requests_write_nothing(capfd):
    server = Server(Live({"source": "x"}), 0)
    try:
        for k in range(60):
            assert asked(server.server_address[1], "/state", host=f"{'evil.' * 200}{k}")[0] == 403
        for first in (b"\xff\xfe\r\n\r\n", b"GET\r\n\r\n", b"PRI * HTTP/2.0\r\n\r\n", b"GET / HTTP/9.9.9\r\n\r\n",
                      b"GET /" + b"x" * 70_000 + b" HTTP/1.1\r\n\r\n",
                      b"GET / HTTP/1.1\r\n" + b"A: b\r\n" * 500 + b"\r\n"):
            with contextlib.suppress(ConnectionError):
                send(server.server_address[1], first)
        assert asked(server.server_address[1], "/state")[0] == 200
    finally:
        server.end()
    assert capfd.readouterr() == ("", "")


# ---- pages of other origins


ROWS_IN_A_BODY = b"\r\n\r\n" + HEADER + stamped([0.01 * k for k in range(100)])
REQUESTS = [
    b"POST / HTTP/1.1\r\nHost: 127.0.0.1:5005" + ROWS_IN_A_BODY,
    b"POST /,t,theta,beta, HTTP/1.1" + ROWS_IN_A_BODY,                        # a first line that names columns
    b"POST /0,0,0,0 HTTP/1.1" + ROWS_IN_A_BODY, b"GET /?0,0,0 HTTP/1.1" + ROWS_IN_A_BODY,
    b"POST /" + b"x" * (3 * LONGEST_LINE) + b" HTTP/1.1" + ROWS_IN_A_BODY,    # longer than a row may be
    b"OPTIONS * HTTP/1.1" + ROWS_IN_A_BODY, b"POST http://127.0.0.1:5005/ HTTP/1.1" + ROWS_IN_A_BODY,
    b"PRI * HTTP/2.0" + ROWS_IN_A_BODY, b"post / http/1.1" + ROWS_IN_A_BODY,
    b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + b"\n" * 9 + ROWS_IN_A_BODY,  # TLS
    b"\x00\x01\x00\x00\x21\x12\xa4\x42" + b"\n" * 9 + ROWS_IN_A_BODY]              # STUN


def test_no_request_of_a_browser_is_rows(nominal, rows, quiet):
    """The request may be cut anywhere; among them a sender of rows is heard as if it were alone."""
    said: list[str] = []
    source = open_source("tcp:0", once=True, say=said.append)
    session = Session(source, nominal)
    with contextlib.ExitStack() as held:
        for request in REQUESTS:
            for size in (len(request), 5):
                sender = held.enter_context(socket.create_connection(("127.0.0.1", port_of(source))))
                sender.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                with contextlib.suppress(ConnectionError):
                    sender.sendall(request[:size])
                    time.sleep(0.001)
                    sender.sendall(request[size:])
        session.until(lambda: source.refused == 2 * len(REQUESTS))
        send(port_of(source), HEADER, *rows)
        made = session.result()
    assert made.report["rows"] == {"read": len(rows), "malformed": 0}
    last = made.report["windows"][-1]["tracked"]
    assert last["a6"] == pytest.approx(quiet["a6"], rel=1e-6)
    assert len(said) == 1 and "a connection that sent HTTP" in said[0]


def test_a_page_of_another_origin_is_told_nothing(nominal):
    server = Server(Live({"source": "x"}), 0)
    port = server.server_address[1]
    ours = f"http://127.0.0.1:{port}"
    try:
        for headers in ({"Origin": "http://evil.example"}, {"Origin": "null"}, {"Origin": "http://127.0.0.1:1"},
                        {"Origin": f"https://127.0.0.1:{port}"}, {"Origin": f"{ours}.evil.example"}, {"Origin": ""},
                        {"Sec-Fetch-Site": "cross-site"}, {"Sec-Fetch-Site": "same-site"},
                        {"Origin": ours, "Sec-Fetch-Site": "cross-site"}):
            for path in ("/events", "/state"):
                assert status(port, path, headers) == 403, (headers, path)
        assert not server.telling
        for headers in ({"Origin": ours}, {"Origin": f"http://localhost:{port}"}, {"Sec-Fetch-Site": "same-origin"},
                        {"Origin": ours, "Sec-Fetch-Site": "same-origin"}, {"Sec-Fetch-Site": "none"}, {}):
            assert status(port, "/state", headers) == status(port, "/", headers) == 200, headers
        assert status(port, "/", {"Sec-Fetch-Site": "cross-site"}) == 200, "a link that stands elsewhere"
    finally:
        server.end()


def status(port: int, path: str, headers: dict[str, str]) -> int:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20.0)
    connection.request("GET", path, headers=headers)
    return connection.getresponse().status


# ---- senders


def test_a_sender_that_says_nothing_more_gives_way_to_one_that_does(nominal, rows, monkeypatch):
    monkeypatch.setattr(sources, "SILENT", 0.2)
    source = open_source("tcp:0", once=False)
    session = Session(source, nominal)
    with connections(port_of(source), MOST_SENDERS + 5), \
            connections(port_of(source), 1, HEADER + b"".join(rows[:100])) as dead:
        session.until(lambda: session.state()["now"].get("rows") == 100)
        with connections(port_of(source), MOST_SENDERS + 5):
            time.sleep(0.5)
            dead[0].sendall(rows[100])
            session.until(lambda: session.state()["now"].get("rows") == 101)
            with socket.create_connection(("127.0.0.1", port_of(source))) as sender:
                sender.sendall(HEADER + b"".join(rows[101:]))
                session.until(lambda: session.state()["now"].get("rows") == len(rows))
                assert len(source._waiting) <= MOST_SENDERS + 1
                source._once = True
    assert session.result().report["rows"] == {"read": len(rows), "malformed": 0}
