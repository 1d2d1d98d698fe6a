"""Run a session of `watch`: from the source's first row to its last, or to Ctrl-C."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from sim.nominal import Nominal
from sim.result import Columns

from ..argument_checks import DEFAULT_WINDOW, LEAST_WINDOWS, Default
from ..convert.mapping import Map
from ..log.check import profile_note
from ..log.cut import WHOLE, Cut
from ..log.table import DRIVEN, REQUIRED
from ..report.answer import Answer, flat
from ..report.identification import table
from .follower import Follower
from .lines import Lines
from .server import Server
from .sources import File, Pipe, Source


@dataclass(frozen=True, eq=False)
class Watched(Answer):
    """Result of `watch`: identify's JSON at the end (`report`), and whether Ctrl-C ended it (`interrupted`)."""

    source: str
    report: dict[str, Any]
    interrupted: bool
    warnings: tuple[str, ...] = ()

    def summary(self) -> str:
        earlier, rows = self.report["earlier_windows"], self.report["rows"]
        lines = [f"{self.source}: {rows['read']} rows, {rows['malformed']} more could not be read"]
        lines += [f"{earlier} earlier windows are left out"] if earlier else []
        return "\n".join([*lines, table(self.report)])

    def columns(self) -> Columns:
        return flat(self.report["windows"])


def watch(source: Source, nominal: Nominal, *, window: float = DEFAULT_WINDOW, period: float | None = None,
          noise: str = "estimated", strict: bool = False, mapping: Map | None = None, cut: Cut = WHOLE,
          http: int = 0, say: Callable[[str], None] = lambda text: None) -> Watched:
    """Follow a source, serve its page until it ends or Ctrl-C comes, and return the result.

    window, period   [s] of the estimator; the default window is at most a third of the nominal's duration; period None:
                     told by the first rows
    strict           raise InputError where the data check of the rows so far finds a fault
    mapping          map of rows with other names and units;  cut  the rows that are used
    http             port of the page on the loopback; 0: any free one
    say              called with lines for the user: the page's address, rows that cannot be read
    Raise KeyboardInterrupt if Ctrl-C comes before the estimator has begun.
    """
    if isinstance(window, Default) and nominal.simulation is not None:
        window = min(float(window), nominal.simulation.duration / LEAST_WINDOWS)
    follower = Follower(source.name, nominal, window=window, period=period, noise=noise, strict=strict, say=say)
    lines = Lines(source.name, isinstance(source, (File, Pipe)), say, mapping,
                  REQUIRED if nominal.actuator is None else DRIVEN)
    server = Server(follower.live, http)
    say(f"watch: {source.name} on {server.url} (Ctrl-C ends)")
    interrupted = False
    try:
        follower.prepare()
        follow(source, lines, follower, cut)
    except KeyboardInterrupt:
        interrupted = True
        if follower.estimator is None:
            raise
        follower.feed_rest()
        follower.check(ended=True)
    finally:
        follower.tick("ended", lines.malformed, lines.last)
        server.end()
    last = follower.estimates[-1].t_end if follower.estimates else -math.inf
    answer = follower.report() | {"rows": {"read": follower.rows, "malformed": lines.malformed}}
    return Watched(source.name, answer, interrupted, profile_note(nominal, last, source.name))


def follow(source: Source, lines: Lines, follower: Follower, cut: Cut = WHOLE) -> None:
    """Feed the follower every row of a source (within the cut) until it ends, and refresh the page after each piece."""
    for piece in source.pieces():
        if piece is None:
            lines.begin_anew()
        else:
            for log in map(cut.of, lines.logs(piece)):
                if len(log.t):
                    follower.take(log)
        follower.tick("following", lines.malformed, lines.last)
    follower.end()
