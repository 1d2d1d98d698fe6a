"""The judgement of the causes: whether they are to be believed, what they gain, and what could not have been seen."""
