"""State that pages show, in fixed memory: written by the follower alone, read by any thread without a lock.

A list here only grows until it is replaced by a new one, and everything else is replaced: what a reader took stays as
it was.
"""

from typing import Any, NamedTuple

Row = tuple[Any, ...]

POINTS_SHOWN = 1500  # of the tracked estimate: more than a page has pixels for
MOST_WINDOWS = 600
POINT = ("t", "a6", "a6_std", "k1", "k1_std", "wind", "wind_std", "delta_a6", "delta_a6_std", "delta_k1",
         "delta_k1_std")
WINDOW_COLUMNS = ("t_start", "t_end", "status", "a6", "a6_std", "k1", "k1_std")


class Series:
    """Rows over the whole time in a list of at most `most`: each time it is full, every other row is dropped, and from
    then on only one of `stride` further rows is kept."""

    def __init__(self, most: int) -> None:
        self.most, self.stride, self._offered = most, 1, 0
        self.rows: list[Row] = []

    def is_due(self) -> bool:
        """Whether `add` will keep the next row."""
        return self._offered % self.stride == 0

    def add(self, row: Row | None) -> None:
        """Count the next row, and keep it if `is_due`; where that is False the row is not read and may be None."""
        if self.is_due() and row is not None:
            self.rows.append(row)
        self._offered += 1
        if len(self.rows) >= self.most:
            self.rows = self.rows[::2]  # another list: who reads the old one goes on reading it
            self.stride *= 2


class Live:
    """All that a page shows: points of the tracked estimate, windows, changes and

    head      what does not change while rows come: names, units, the nominal
    now       the latest numbers
    revision  counter that grows with every change of any of them
    """

    def __init__(self, head: dict[str, Any]) -> None:
        self.head = head
        self.now: dict[str, Any] = {"state": "waiting"}
        self.points, self.windows = Series(POINTS_SHOWN), Series(MOST_WINDOWS)
        self.changes: list[dict[str, Any]] = []
        self.revision = 0


class Seen(NamedTuple):
    """What a page has received already: the head and the lists of points and windows, by identity, and how many of
    their rows."""

    head: dict[str, Any]
    points: list[Row]
    windows: list[Row]
    n_points: int
    n_windows: int


def message(live: Live, seen: Seen | None) -> tuple[dict[str, Any], Seen]:
    """Return (message, Seen): what a page lacks of `live`; all, `head` too, if `seen` is None or a list was thinned."""
    head, points, windows = live.head, live.points.rows, live.windows.rows
    now = Seen(head, points, windows, len(points), len(windows))
    always = {"now": live.now, "changes": live.changes}
    if seen is None or seen.head is not head or seen.points is not points or seen.windows is not windows:
        return {"head": head, "points": points[:now.n_points], "windows": windows[:now.n_windows], **always}, now
    return {"points": points[seen.n_points:now.n_points], "windows": windows[seen.n_windows:now.n_windows],
            **always}, now
