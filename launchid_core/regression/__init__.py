"""The formulations that regress on the rows of a window."""
