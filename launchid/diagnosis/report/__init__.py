"""The report of a diagnosis: one HTML page and its figures."""
