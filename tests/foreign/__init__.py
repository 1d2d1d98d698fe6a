"""Simulators that nobody of this project wrote, as judges."""
