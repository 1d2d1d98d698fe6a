"""Whether they are to be believed, what they buy, and what could not have been seen."""
