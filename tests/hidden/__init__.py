"""Flights with a hidden effect, for the tests of the diagnosis: an independent simulator with names of its own.

It imports nothing of the project (numpy, numba and the standard library; the profile tables are read as data), so a
mistake in the project's physics does not cancel against itself.  `fly` gives what a log may hold and, apart from it,
the truth.
"""

from .catalogue import LISTED, UNLISTED, hide, size_at
from .flight import draw_spec, fly, write_csv
from .spec import OTHER, PLAIN, QUIET, Hidden, Label, Noise, Spec, Weather

__all__ = ["LISTED", "OTHER", "PLAIN", "QUIET", "UNLISTED", "Hidden", "Label", "Noise", "Spec", "Weather", "draw_spec",
           "fly", "hide", "size_at", "write_csv"]
