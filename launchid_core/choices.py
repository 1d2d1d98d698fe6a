"""The words of a `Config`'s choices, apart from what compiles: a command can list them without numba."""

FORMULATIONS = ("measured", "difference", "integral", "filtered")
NOISE_LEVELS = ("estimated", "declared")
SOLVERS = ("stls", "sr3", "ssr", "lasso")
