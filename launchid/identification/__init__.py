"""Identification of a log, window by window, and what its windows promise."""
