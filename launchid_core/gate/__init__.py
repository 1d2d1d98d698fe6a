"""One sample in, one status out: gate and ring, what a window's close leaves, sensors that stand still, seals."""
