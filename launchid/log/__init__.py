"""A log as it was measured: read, and checked before anything uses it."""
