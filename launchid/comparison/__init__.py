"""Compare a log with nominals: predictions, flights from its reference, dispersed flights, frequency responses."""
