"""The log's commands: whose they are, recomputed where the log lacks them, filled in where it is too slow."""
