"""The result of a controller's check: which part of the controller on board is not the nominal's."""

from dataclasses import dataclass, replace

GAIN, DELAY, FILTER, UNKNOWN, NONE = "gain", "delay", "filter", "unknown", "none"
ROUNDING = 2.0e-5       # rad rms: what rounding in a log's digits may make of an exact command
NEAR_LIMIT = 0.999      # of the deflection limit: beyond it a command says nothing about gains
FEWEST = 20             # commands, or gaps between them, without which nothing is said


@dataclass(frozen=True)
class ControllerCheck:
    """How the logged commands differ from the nominal controller's.

    before, after  rms [rad] of the difference, and after the best explanation
    kind         "gain", "delay", "filter", these joined by " and ", "unknown", or "none" when it is the nominal's
    delay        [s] of computing time
    std          of kp_scale, kd_scale, delay
    evidence     nats, for a white difference
    time_constant  [s] of the derivative, where that is part of the explanation
    integral_scale  of ki, in a rate law, where that is the explanation
    """

    kind: str
    before: float
    after: float
    kp_scale: float = 1.0
    kd_scale: float = 1.0
    delay: float = 0.0
    std: tuple[float, float, float] = (0.0, 0.0, 0.0)
    time_constant: float | None = None
    evidence: float = 0.0
    integral_scale: float | None = None

    @property
    def is_named(self) -> bool:
        """The catalogue's `controller_mismatch` explains it, beside another filter or not."""
        return not self.is_foreign and self.kind != NONE

    @property
    def is_foreign(self) -> bool:
        """The command is not the nominal controller's, and no gains and no computing time make it so."""
        return self.kind in (UNKNOWN, FILTER)

    @property
    def words(self) -> str:
        """The mismatch in words: how far apart commands are, or which filter would explain it."""
        if self.kind == FILTER and self.time_constant is not None:
            return f"a derivative time constant of {self.time_constant:.4g} s would explain it"
        if self.integral_scale is not None:
            return f"{self.integral_scale:.4g} times the nominal's ki and {self.kp_scale:.4g} times its kp " \
                   "would explain it"
        return f"{self.before:.2g} rad rms apart, {self.after:.2g} after the best gains and delay"

    def late(self, period: float) -> int:
        """Computing time in whole controller periods [s]."""
        return round(self.delay / period)

    def of_kind(self, same: float, period: float) -> "ControllerCheck":
        """The check with its kind: which parts differ by more than `same`, relative; of the period [s] for a delay."""
        parts = {GAIN: abs(self.kp_scale - 1.0) > same or abs(self.kd_scale - 1.0) > same,
                 DELAY: self.delay > same * period, FILTER: self.time_constant is not None}
        return replace(self, kind=" and ".join(name for name, differs in parts.items() if differs) or NONE)
