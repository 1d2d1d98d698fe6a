"""Uncertainty of a6 and k1: the LFT of the closed loop, its classical margins, its structured singular value."""
