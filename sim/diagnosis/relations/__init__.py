"""Which part of the equation of motion is missing, by regression on the log: the look before the likelihood's search."""
