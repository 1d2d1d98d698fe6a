"""Judge logs and windows: every reason for which an answer is refused stands in one table (`table.TESTS`)."""
