"""The speed of a campaign, and how it grows with the workers.

    python benchmarks/campaign.py [--flights 10000] [--growth 400] [--workers N] [--table FILE]

A job: the constant nominal with delta uniform in [-1, 1]^2, flown for 70 s (`flight` sensors, 100 Hz) and identified
by the filtered estimator in 1 s windows.  First `--growth` flights each with 1, 2, 4, ... workers up to all cores, in
new processes that have loaded the compiled code; their tables must agree to the bit.  Then the campaign.

Demand: 10,000 flights on two cores in less than 600 s, as measured or, with fewer flights, extrapolated.
"""

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

from launchid.cli.terminal import shown_counter
from launchid.monte_carlo.campaign import draw_jobs, run_campaign
from launchid.robustness.montecarlo import identify

FLIGHTS, SECONDS, CORES = 10_000, 600.0, 2  # the demand
WARM_SEED = 1_000_000  # of a flight that only compiles


def timed(flights: int, workers: int, path: Path) -> float:
    """Seconds of a campaign, the start of its processes included."""
    jobs = draw_jobs("constant", "box", range(flights))
    start = time.perf_counter()
    table = run_campaign(jobs, identify, path, workers=workers, progress=shown_counter(flights, "flights"))
    seconds = time.perf_counter() - start
    if table.failed:
        raise RuntimeError(f"{table.failed} of {flights} flights failed, see {path}")
    return seconds


def counts(cores: int) -> list[int]:
    """1, 2, 4, ... workers and all cores."""
    return sorted({*(2**k for k in range(cores.bit_length()) if 2**k <= cores), cores})


def main() -> int:
    """Run and print; exit status 1 if a demand is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=FLIGHTS)
    parser.add_argument("--growth", type=int, default=400, help="flights of each point of the growth; 0: none")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="of the campaign")
    parser.add_argument("--table", type=Path, help="where the campaign's table stays; an interrupted one is continued")
    args = parser.parse_args()
    identify(draw_jobs("constant", "box", [WARM_SEED])[0])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        texts, first = set(), 0.0
        for workers in counts(args.workers) if args.growth else ():
            path = folder / f"growth_{workers}.csv"
            rate = args.growth / timed(args.growth, workers, path)
            first = first or rate
            texts.add(path.read_bytes())
            print(f"workers {workers:3d}: {rate:7.1f} flights/s, {rate / first:5.2f} times one worker's", flush=True)
        same = len(texts) <= 1
        print(f"tables of all numbers of workers agree to the bit: {'yes' if same else 'NO'}")
        seconds = timed(args.flights, args.workers, args.table or folder / "campaign.csv")
    rate = args.flights / seconds
    whole = FLIGHTS / rate
    said = "measured" if args.flights == FLIGHTS else "extrapolated"
    good = same and (whole < SECONDS or args.workers != CORES)
    print(f"{args.flights} flights flown and identified, {args.workers} workers: {seconds:.1f} s, "
          f"{rate:.1f} flights/s; {FLIGHTS} flights: {whole:.0f} s "
          f"({said}; demanded on {CORES} cores: less than {SECONDS:.0f} s) {'' if good else 'MISSED'}")
    return int(not good)


if __name__ == "__main__":
    sys.exit(main())
