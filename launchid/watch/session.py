"""A session: from the source's first row to its last, or to Ctrl-C."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from sim.nominal import Nominal
from sim.result import Columns

from ..argument_checks import DEFAULT_WINDOW
from ..convert.mapping import Map
from ..identification.windows import table
from ..log.check import profile_note
from ..results.answer import Answer, flat
from .follower import Follower
from .lines import Lines
from .server import Server
from .sources import File, Pipe, Source


@dataclass(frozen=True, eq=False)
class Watched(Answer):
    """The answer of `watch`: what was known at the end."""

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
          noise: str = "estimated", strict: bool = False, mapping: Map | None = None, http: int = 0,
          say: Callable[[str], None] = lambda text: None) -> Watched:
    """Follow a source and serve the page until it ends or Ctrl-C comes.

    window, period   [s] of the estimator; period None: what the first rows say
    strict           what the data check of the rows so far finds is an InputError
    mapping          the map of rows with other names and units
    http             port of the page on the loopback; 0: any free one
    say              told where the page is, and of rows that cannot be read
    KeyboardInterrupt if it came before there was anything to tell.
    """
    follower = Follower(source.name, nominal, window=window, period=period, noise=noise, strict=strict, say=say)
    lines = Lines(source.name, isinstance(source, (File, Pipe)), say, mapping)
    server = Server(follower.live, http)
    say(f"watch: {source.name} on {server.url} (Ctrl-C ends)")
    interrupted = False
    try:
        follower.prepare()
        follow(source, lines, follower)
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


def follow(source: Source, lines: Lines, follower: Follower) -> None:
    """Every row of a source to the follower, until the source ends."""
    for piece in source.pieces():
        if piece is None:
            lines.begin_anew()
        else:
            for log in lines.logs(piece):
                follower.take(log)
        follower.tick("following", lines.malformed, lines.last)
    follower.end()
