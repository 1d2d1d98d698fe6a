"""The command `launchid` as a process: it announces compilation, and can be interrupted from its first moment."""

import os
import signal
import sys
from types import FrameType

from sim.errors import INTERRUPTED, INTERRUPTED_STATUS

THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


def _leave(number: int, frame: FrameType | None) -> None:
    """End the process on Ctrl-C while modules are imported: an exception there may be caught by an importer."""
    os.write(2, f"{INTERRUPTED}\n".encode())
    os._exit(INTERRUPTED_STATUS)


def command() -> int:
    """Run `launchid` as the console script (numpy on one thread, output in UTF-8); return the exit status."""
    ours = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # else it is ignored, as under nohup
    if ours:
        signal.signal(signal.SIGINT, _leave)
    os.environ.update(dict.fromkeys(THREADS, "1"))  # before numpy reads them: sums that are split differ in a digit
    from .cli.compilation import announce
    from .cli.terminal import speak_utf8
    from .main import main
    announce()
    speak_utf8()
    if ours:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    return main()


if __name__ == "__main__":
    sys.exit(command())
