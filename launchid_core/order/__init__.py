"""Memory, and the order of it all."""
