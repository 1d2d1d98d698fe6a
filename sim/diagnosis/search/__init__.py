"""Which causes the log asks for."""
