"""The paper's experiments, and their companions under sensor noise: CASES, and CONFIDENCE, the name of one more."""

from .cases import CASES, CONFIDENCE

__all__ = ["CASES", "CONFIDENCE"]
