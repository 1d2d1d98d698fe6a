"""Export the estimator as C source for a flight computer."""
