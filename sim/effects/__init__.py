"""The causes of the contract as composable extensions of the simulator: one definition of each.

Layers: `table` says what an effect is, one file per place holds its register, what each effect changes, and the
physics; `catalogue` finds, checks and packs.  The compiled step calls places, never single effects.
"""

from .catalogue import CATALOGUE, effect, from_table, from_text, pack, values
from .table import Cause, Changes, Effect, Parameter

__all__ = ["CATALOGUE", "Cause", "Changes", "Effect", "Parameter", "effect", "from_table", "from_text", "pack",
           "values"]
