"""A look at the equation of motion by regression: which part of it is missing, listed in the catalogue or not."""
