"""Figures of logs and results."""
