"""The words of a `Config`'s choices, apart from what compiles: a command can list them without numba."""

FORMULATIONS = ("measured", "difference", "integral", "filtered")
NOISE_LEVELS = ("estimated", "declared")
SLOWEST = 2.5  # controller periods between samples of `filtered`: beyond it too few of the commands are known
SOLVERS = ("stls", "sr3", "ssr", "lasso")
