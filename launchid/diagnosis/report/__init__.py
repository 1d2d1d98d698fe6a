"""The report of a diagnosis: one page, its figures."""
