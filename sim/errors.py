"""Errors of a user's input, told in one line (InputError: a file, UsageError: the command), and exit statuses."""

import contextlib
import difflib
from collections.abc import Iterable, Iterator

INTERRUPTED = "launchid: interrupted; files already written are whole"
INTERRUPTED_STATUS = 130  # as a shell says of what an interrupt ended

EXTRAS = {  # module -> the extra that brings it
    "matplotlib": "plots", "distributed": "cluster", "pandas": "frames",
    "pyulog": "logs", "mcap": "logs", "h5py": "logs", "pyarrow": "logs", "scipy": "logs",
    "zstandard": "logs",
    "pymavlink": "ardupilot", "control": "control"}


def one_line(text: str) -> str:
    """Return the text with every unprintable character escaped, so that it stays one line."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


def did_you_mean(word: str, words: Iterable[str], otherwise: str = "") -> str:
    """Return the question after the nearest of the words, or `otherwise` where none is near.

    Examples
    --------
    >>> did_you_mean("identfy", ["identify", "margins"])
    'did you mean identify?'
    """
    near = difflib.get_close_matches(word.casefold(), list(words), 1, cutoff=0.6) or \
        sorted((each for each in words if len(word) > 2 and each.startswith(word)), key=len)[:1]
    return f"did you mean {near[0]}?" if near else otherwise


class Told(Exception):
    """Base of the errors whose message is one line written for the user."""

    def __str__(self) -> str:
        return one_line(super().__str__())


class InputError(Told):
    """A file cannot be used: one line naming file, place and what was expected (exit status 3)."""


class UsageError(Told):
    """The command's words or parameters are wrong (exit status 2)."""


def extra_needed(error: ModuleNotFoundError) -> UsageError:
    """Return the UsageError that says which extra installs the missing module; any other module's error is raised
    again."""
    name = (error.name or "").split(".")[0]
    if name not in EXTRAS:
        raise error
    return UsageError(f"this needs {name}, which is not installed: pip install 'launchid[{EXTRAS[name]}]'")


@contextlib.contextmanager
def extras_named() -> Iterator[None]:
    """Turn a ModuleNotFoundError of an extra's module within the context into a UsageError that names the extra."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise extra_needed(error) from None
