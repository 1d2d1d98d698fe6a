"""The estimator in C, for a flight computer."""
