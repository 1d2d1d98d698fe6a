"""Robustness of the closed loop to errors of a6 and k1: LFT, classical margins, structured singular value (mu)."""
