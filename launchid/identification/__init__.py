"""Identify a log window by window, and say which of its windows are valid."""
