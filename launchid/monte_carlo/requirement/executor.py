"""The executor of a campaign: `local`, this machine's processes, or `dask:ADDRESS`, the workers of a dask scheduler."""

import contextlib
from collections.abc import Iterator
from concurrent.futures import Executor

from sim.errors import UsageError, extra_needed

SCHEDULER_TIMEOUT = 10.0  # s, for a scheduler to answer
EXECUTOR_FORM = "expected local, or dask:ADDRESS such as dask:tcp://node1:8786"


def check_executor(text: str) -> None:
    """UsageError for words that name none."""
    if text != "local" and not (text.startswith("dask:") and len(text) > len("dask:")):
        raise UsageError(f"--executor {text!r}: {EXECUTOR_FORM}")


@contextlib.contextmanager
def executor_of(text: str, workers: int | None) -> Iterator[tuple[Executor | None, int | None]]:
    """(executor, how many workers it has) while this lasts; (None, workers): processes, which the campaign makes."""
    check_executor(text)
    if text == "local":
        yield None, workers
        return
    try:
        from distributed import Client
    except ModuleNotFoundError as error:
        raise extra_needed(error) from None
    address = text.removeprefix("dask:")
    try:
        client = Client(address, timeout=SCHEDULER_TIMEOUT)
    except (OSError, ValueError) as error:
        raise UsageError(f"--executor {text}: no scheduler answers there ({type(error).__name__}); "
                         f"{EXECUTOR_FORM}") from None
    with client:
        threads = sum(client.nthreads().values())
        if threads == 0:
            raise UsageError(f"--executor {text}: the scheduler has no workers")
        yield client.get_executor(), workers or threads
