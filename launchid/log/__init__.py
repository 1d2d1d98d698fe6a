"""Read flight logs, and check them before anything uses them."""
