"""Several flights of one vehicle in one answer: the joint numbers, are they of one, their scatter."""
