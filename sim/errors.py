"""The two ways a user's input can be wrong."""


class InputError(Exception):
    """A file cannot be used: one line naming file, place and what was expected (exit status 3)."""


class UsageError(Exception):
    """The command's words or parameters are wrong (exit status 2)."""
