"""The causes (effects) of the catalogue as extensions of the simulator that can be combined, each defined once.

Layers: `table` has their types; one file per place has its causes, their changes and their
physics; `catalogue` finds, checks and packs.  The compiled step calls places, never single effects.
"""

from .catalogue import CATALOGUE, effect, from_table, from_text, pack, values
from .table import Cause, Changes, Effect, Parameter

__all__ = ["CATALOGUE", "Cause", "Changes", "Effect", "Parameter", "effect", "from_table", "from_text", "pack",
           "values"]
