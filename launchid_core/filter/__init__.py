"""The innovations form: the vehicle and its world, predicted and corrected; blocks, a window's fit, its check."""
