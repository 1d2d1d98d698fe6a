"""The causes of the contract as composable extensions of the simulator: one definition of each.

Layers: `table` says what an effect is, one file per place holds the physics and
its register, `catalogue` finds, checks and packs.  The compiled step calls places,
never single effects.
"""

from .catalogue import CATALOGUE, effect, from_table, from_text, pack, values
from .table import Cause, Effect, Parameter, Table

__all__ = ["CATALOGUE", "Cause", "Effect", "Parameter", "Table", "effect", "from_table", "from_text", "pack", "values"]
