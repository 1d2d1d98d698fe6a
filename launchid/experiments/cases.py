"""The paper's experiments: nominal flown, ways of identification, and the claim that must hold.

Source: Navarro-Tapia, Marcos & Belhadj, sections 4.1 to 4.3.  Tolerances are
those of the paper's claims (1 %) or, where the parameter itself passes through
zero, max(2 %, 0.02 1/s^2).
"""

from dataclasses import dataclass

CONSTANT_SUPPORT = ("theta", "beta")
CONFIDENCE = "confidence"  # the case of `confidence.py`, which flies differently


@dataclass(frozen=True)
class Variant:
    """A way to identify a flight: window [s], formulation, solver, sensor suite, command noise [rad] if changed."""

    name: str
    window: float          # s
    library: str
    formulation: str
    compression: int = 3
    suite: str = "ideal"
    command_noise: float | None = None   # rad, instead of the nominal's
    solver: str = "stls"
    threshold: float | None = None


@dataclass(frozen=True)
class Case:
    """One experiment: nominal, deltas flown, variants (the paper's first), the claim and its tolerance."""

    name: str
    paper: str
    claim: str
    nominal: str
    deltas: tuple[int, ...]
    variants: tuple[Variant, ...]
    relative: float               # tolerance: relative to the truth
    absolute: float = 0.0         # tolerance: at least this, 1/s^2
    support: tuple[str, ...] = () # exact support demanded of the theta_ddot equation
    proposed_sigma: bool = False  # the second dispersion profile
    has_claim: bool = True        # the first variant is the paper's, and judged by the tolerance


def _noisy(*windows: float) -> tuple[Variant, ...]:
    """Return variants with flight sensors, filtered and integral, for each window [s]: short ones cannot reach 1 %."""
    return tuple(Variant(f"flight sensors, {formulation}, {w:g} s", w, "rigid-body", formulation, 1, "flight")
                 for w in windows for formulation in ("filtered", "integral"))


def _varying(window: float) -> tuple[Variant, ...]:
    return (Variant("lpv, measured", window, "lpv", "measured"),
            Variant("paper's constant fit", window, "rigid-body", "measured"),
            Variant("lpv, difference", window, "lpv", "difference"))


_EXCITED = Variant("paper's constant fit, 0.05 rad command noise", 0.3, "rigid-body", "measured", command_noise=0.05)

CASES = {case.name: case for case in (
    Case("constant", "4.1, Fig. 2", "a6 = 2, k1 = -7 from a whole flight; support {theta, beta}", "constant", (0,),
         (Variant("ten terms, measured", 70.0, "quadratic", "measured"),
          Variant("ten terms, difference", 70.0, "quadratic", "difference"), *_noisy(70.0)),
         0.001, support=CONSTANT_SUPPORT),
    Case("windowed", "4.2, Fig. 3", "70 windows of 1 s below 1 %", "constant", (0,),
         (Variant("ten terms, measured", 1.0, "quadratic", "measured"),
          Variant("ten terms, difference", 1.0, "quadratic", "difference"), *_noisy(1.0, 10.0)),
         0.01, support=CONSTANT_SUPPORT),
    Case("dispersed", "4.2, Fig. 4", "dispersed vehicles below 1 %", "constant", (-1, 0, 1),
         (Variant("ten terms, measured", 1.0, "quadratic", "measured"), *_noisy(1.0, 10.0)), 0.01,
         support=CONSTANT_SUPPORT),
    Case("vega", "4.3, Fig. 5, 6", "varying dynamics tracked in 0.3 s windows", "vega_like", (0,),
         (*_varying(0.3), _EXCITED, *_noisy(1.0, 10.0)), 0.02, 0.02),
    Case("vega-dispersed", "4.3, Fig. 7, 8", "dispersed varying dynamics, sigma 0.25", "vega_like", (-1, 0, 1),
         _varying(0.3)[:1] + _noisy(1.0), 0.02, 0.02),
    Case("vega-dispersed-profile", "4.3, Fig. 7, 8", "the same, sigma over flight time (proposed, not public)",
         "vega_like", (-1, 0, 1), _varying(0.3)[:1], 0.02, 0.02, proposed_sigma=True),
    Case("greensite", "beyond", "a second, sourced vehicle with a kink at 72 s", "greensite_cr826", (0,),
         (*_varying(0.3), _EXCITED, *_noisy(1.0, 10.0)), 0.02, 0.02),
    Case("tuning", "2.2, 4.2", "threshold, and window by compression: the trade-offs left to the reader", "constant",
         (0,),
         (*(Variant(f"difference, threshold {x:g}", 1.0, "quadratic", "difference", 3, threshold=x)
            for x in (0.01, 0.05, 0.1, 0.5, 1.0, 1.5, 3.0)),
          *(Variant(f"difference, window {w:g} s, compression {c}", w, "quadratic", "difference", c)
            for w in (0.3, 1.0, 3.0) for c in (1, 3, 10)),
          *(Variant(f"flight sensors, integral, {w:g} s, compression {c}", w, "rigid-body", "integral", c, "flight")
            for w in (0.3, 1.0, 3.0, 10.0) for c in (1, 3))), 0.01, support=CONSTANT_SUPPORT,
         has_claim=False),
)}
