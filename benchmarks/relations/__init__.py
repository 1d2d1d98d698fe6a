"""A baseline of the diagnosis: which part of the equation of motion is missing, by regression on the log alone.

`look.look` needs no likelihood, no filter and no wind: a weak-form regression with one table of alternatives, listed in
the catalogue or not, and one score on rows left out.  `benchmarks/diagnosis_look.py` prints it beside the labels.
"""
