"""Figures of logs and of the paper's experiments."""
