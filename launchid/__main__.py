"""The command `launchid` as a process: it says when it has to compile, and can be interrupted from its first moment."""

import os
import signal
import sys
from types import FrameType

from sim.errors import INTERRUPTED, INTERRUPTED_STATUS

THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


def _leave(number: int, frame: FrameType | None) -> None:
    """Leave while modules are imported: an exception there may be caught, or printed, by whoever imports."""
    os.write(2, f"{INTERRUPTED}\n".encode())
    os._exit(INTERRUPTED_STATUS)


def fly_in_plain_python() -> None:
    """Compile nothing for an export whose kernels are not kept: plain Python gives the same bits."""
    import numba

    from launchid_core.cache import has_kernels
    words = " ".join(sys.argv).replace("=", " ").split()
    formulation = words[words.index("--formulation") + 1:][:1] if "--formulation" in words else ["filtered"]
    if not has_kernels("launchid_core.order.onboard" if formulation == ["filtered"]
                       else "launchid_core.regression.regression"):
        numba.config.DISABLE_JIT = 1  # type: ignore[attr-defined]


def command() -> int:
    """The console script."""
    ours = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # else it is ignored, as under nohup
    if ours:
        signal.signal(signal.SIGINT, _leave)
    os.environ.update(dict.fromkeys(THREADS, "1"))  # before numpy reads them: sums that are split differ in a digit
    if sys.argv[1:2] == ["export-c"]:
        fly_in_plain_python()
    from .cli.compilation import announce
    from .cli.main import main
    from .cli.terminal import speak_utf8
    announce()
    speak_utf8()
    if ours:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    return main()


if __name__ == "__main__":
    sys.exit(command())
