"""The speed of a campaign, and how it grows with the workers.

    python benchmarks/campaign.py [--flights 10000] [--growth 400] [--workers N]

A job: the constant nominal with delta uniform in [-1, 1]^2, flown for 70 s (`flight` sensors, 100 Hz) and identified
by the filtered estimator in 1 s windows.  First `--growth` flights with one worker and with all, in new processes that
have loaded the compiled code; their tables must agree to the bit.  Then the campaign.

Demand: 10,000 flights on two cores in less than 600 s, as measured or, with fewer flights, extrapolated.
"""

import os
import sys
import tempfile
import time
from pathlib import Path

from flights import arguments

from launchid.cli.terminal import shown_counter
from launchid.monte_carlo.campaign import draw_jobs, run_campaign
from launchid.robustness.montecarlo import identify

FLIGHTS, SECONDS, CORES = 10_000, 600.0, 2  # the demand
WARM_SEED = 1_000_000  # of a flight that only compiles


def timed(flights: int, workers: int, path: Path) -> float:
    """Return the time [s] of a campaign, the start of its processes included; RuntimeError if a flight failed."""
    jobs = draw_jobs("constant", "box", range(flights))
    start = time.perf_counter()
    table = run_campaign(jobs, identify, path, workers=workers, progress=shown_counter(flights, "flights"))
    seconds = time.perf_counter() - start
    if table.failed:
        raise RuntimeError(f"{table.failed} of {flights} flights failed, see {path}")
    return seconds


def main() -> int:
    """Run and print; exit status 1 if a demand is missed."""
    cores = os.cpu_count() or 1
    args = arguments(__doc__, flights=FLIGHTS, growth=400, workers=cores)
    identify(draw_jobs("constant", "box", [WARM_SEED])[0])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        alone = timed(args.growth, 1, folder / "one.csv") / args.growth
        shared = timed(args.growth, args.workers, folder / "all.csv") / args.growth
        same = (folder / "one.csv").read_bytes() == (folder / "all.csv").read_bytes()
        seconds = timed(args.flights, args.workers, folder / "campaign.csv")
    print(f"{args.workers} workers: {alone / shared:.2f} times the rate of one; their tables agree to the bit: "
          f"{'yes' if same else 'NO'}")
    whole = FLIGHTS * seconds / args.flights
    good = same and (whole < SECONDS or args.workers != CORES)
    print(f"{args.flights} flights flown and identified: {seconds:.1f} s; {FLIGHTS} flights: {whole:.0f} s (demanded "
          f"on {CORES} cores: less than {SECONDS:.0f} s) {'' if good else 'MISSED'}")
    return int(not good)


if __name__ == "__main__":
    sys.exit(main())
