"""Numbers in, numbers out: least squares, sparse regression, elementary functions, derivatives, library, row choice."""
