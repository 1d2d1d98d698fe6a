"""The paper's experiments and their honest companions under sensor noise."""

from .cases import CASES, CONFIDENCE

__all__ = ["CASES", "CONFIDENCE"]
