"""A log beside what one or several nominals say of it: predictions, flights, dispersions, frequency responses."""
