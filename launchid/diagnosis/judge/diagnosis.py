"""The diagnosis of one log: the verdict and everything it rests on."""

from dataclasses import dataclass, field
from typing import Any

from sim.nominal import Nominal

from ...log.detect import DataCheck
from ...log.log import Log
from ..controller.kind import ControllerCheck
from ..data.record import Record
from ..data.used import Used
from ..search.proposal import Proposal
from ..search.selection import THRESHOLD, Selection
from .gain import Gain
from .leftover import Leftover
from .limits import Isolability, Limit
from .measure import Remainder
from .named import Named
from .user_gain import UserGain


@dataclass(eq=False)
class Diagnosis:
    """Everything that was found; arrays and models for the report, words for the verdict.

    open       what is there, and within what the nominal leaves open: no cause
    doubts     why the best causes are not believed (unexplained), one line each
    nearest    the best causes of an `unexplained` log: they are not its cause
    proposal   missing terms that would help an `unexplained` log
    remaining  why causes that are there beyond doubt do not explain everything, one line each
    remainder  what they leave (dominant)
    used       which rows of a log that is long were fitted; None: all
    is_cut_short  the emergency brake ended the search: nothing is concluded (`stopped`)
    is_spent   the search ended with its effort: the best answer so far
    catalogue  whether all causes were allowed, missing terms too
    """

    log: Log
    nominal: Nominal
    data: DataCheck
    verdict: str = "bad-data"
    where: str | None = None
    causes: tuple[Named, ...] = ()
    open: tuple[Named, ...] = ()
    nearest: tuple[Named, ...] = ()
    doubts: tuple[str, ...] = ()
    record: Record | None = None
    selection: Selection | None = None
    controller: ControllerCheck | None = None
    left_nominal: tuple[Leftover, ...] = ()
    left: tuple[Leftover, ...] = ()
    limits: tuple[Limit, ...] = ()
    isolability: Isolability | None = None
    noise: dict[str, dict[str, Any]] = field(default_factory=dict)
    gain: Gain | None = None
    extension: Nominal | None = None
    user: UserGain | None = None
    proposal: Proposal | None = None
    remaining: tuple[str, ...] = ()
    remainder: Remainder | None = None
    is_cut_short: bool = False
    is_spent: bool = False
    used: Used | None = None
    threshold: float = THRESHOLD
    catalogue: bool = True

    def stopped(self) -> "Diagnosis":
        """The diagnosis that is left when the brake ends the search or its judgement: no verdict, no cause, no
        numbers."""
        return Diagnosis(self.log, self.nominal, self.data, "unexplained", record=self.record,
                         controller=self.controller, used=self.used, threshold=self.threshold,
                         catalogue=self.catalogue, is_cut_short=True)
