"""The paper's experiments and their honest companions under sensor noise."""

from .cases import CASES

__all__ = ["CASES"]
