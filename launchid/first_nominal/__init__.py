"""The first nominal of a vehicle, from its log alone (`launchid nominal`).

log -> channels (rows masked) -> weak (first numbers, placebo) -> search (filter, model, scoring: which model, its
maximum of the likelihood) -> answer (numbers, standard deviations, what is not known) -> write (file, JSON, text)
"""

from .answer import First, first
from .flights import of_flights
from .write import lines, nominal_of, report, write

__all__ = ["First", "first", "lines", "nominal_of", "of_flights", "report", "write"]
