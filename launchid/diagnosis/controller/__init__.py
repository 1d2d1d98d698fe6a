"""The command: whose it is, recomputed where the log lacks it, filled in where the log is too slow."""
