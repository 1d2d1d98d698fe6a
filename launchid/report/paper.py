"""`launchid reproduce`: fly the experiments, judge the paper's claims, write tables and figures into one folder."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from launchid_core import polynomial
from sim.files import make_folder, write_text
from sim.nominal import built_in, load_nominal

from ..bound.flights import flight_bound
from ..experiments import confidence
from ..experiments.cases import CASES, CONFIDENCE, Case
from ..experiments.flights import (
    EXACT,
    NODE,
    TRUE_A6,
    TRUE_K1,
    VALID,
    WINDOW_A6,
    WINDOW_K1,
    Result,
    VehicleJob,
    fly_job,
    vehicle_jobs,
)
from ..formatting import json_number
from ..monte_carlo.campaign import run_jobs
from ..progress import Counter
from .answer import json_text

BOUND_SEEDS = 3  # the bound varies by a percent between flights


def score(case: Case, variant: int, results: list[Result]) -> dict[str, Any]:
    """Return worst and median relative errors of one variant over all windows of all flights, and how many windows are
    inside the tolerance.  Windows over a profile's node are counted apart on clean data."""
    table = np.concatenate([result.tables[variant] for result in results])
    # a window over a node is judged apart only on clean data: under sensor noise the node is not what shows
    node = (table[:, NODE] == 1) & (case.variants[variant].suite == "ideal")
    errors = np.abs(table[:, [WINDOW_A6, WINDOW_K1]] - table[:, [TRUE_A6, TRUE_K1]])
    truth = np.abs(table[:, [TRUE_A6, TRUE_K1]])
    tolerance = np.maximum(case.relative * truth, case.absolute)
    inside = (errors <= tolerance).all(axis=1) & (table[:, VALID] == 1)
    relative = errors / np.maximum(truth, case.absolute / case.relative if case.absolute else 0.0)
    clear = ~node

    def worst(values: np.ndarray) -> float | None:
        return json_number(float(np.max(values))) if len(values) and np.isfinite(values).all() else None

    return {
        "windows": len(table), "valid": int(np.sum(table[:, VALID] == 1)), "inside": int(np.sum(inside & clear)),
        "counted": int(np.sum(clear)), "over_node": int(np.sum(node)), "over_node_inside": int(np.sum(inside & node)),
        "over_node_worst": worst(relative[node]), "exact_support": int(np.sum(table[:, EXACT])),
        "worst_a6": worst(relative[clear, 0]), "worst_k1": worst(relative[clear, 1]),
        "median_a6": json_number(float(np.nanmedian(relative[clear, 0]))),
        "median_k1": json_number(float(np.nanmedian(relative[clear, 1]))),
        "lost": sum(result.lost for result in results), "flights": len(results)}


def holds(case: Case, scores: dict[str, Any]) -> bool:
    """Whether the paper's claim holds: all windows off nodes inside the tolerance, no flight lost, support exact."""
    exact = not case.support or scores["exact_support"] == scores["windows"]
    return bool(scores["inside"] == scores["counted"] and scores["lost"] == 0 and exact)


def percent(x: float | None) -> str:
    """Return a share as a percentage of two digits, `1.2 %`; "-" for None."""
    return "-" if x is None else f"{100 * x:.2g} %"


class FloorJob(NamedTuple):
    """A job: compute the bound of a built-in nominal's flights in windows of `window` [s]."""

    nominal: str
    window: float


Job = VehicleJob | FloorJob | confidence.BandJob


def floors_of(case: Case) -> list[FloorJob]:
    """Return the bound's jobs that a case's table needs: one per variant with flight sensors."""
    return [FloorJob(case.nominal, variant.window) for variant in case.variants if variant.suite == "flight"]


def noise_floor(job: FloorJob) -> float:
    """Return the median Cramer-Rao bound of a6, relative, over the windows of BOUND_SEEDS flights."""
    nominal = load_nominal(built_in(job.nominal))
    return float(np.median(np.concatenate([flight_bound(nominal, job.window, seed).a6 for seed in range(BOUND_SEEDS)])))


def verdict(case: Case, k: int, scores: dict[str, Any]) -> str:
    """Return a variant's verdict: "holds" or "FAILS" for the paper's (k = 0), else "companion"; "" without a claim."""
    if not case.has_claim:
        return ""
    if k == 0:
        return "holds" if holds(case, scores) else "FAILS"
    return "companion"


def table_lines(all_scores: dict[str, list[dict[str, Any]]]) -> list[str]:
    """Return the Markdown table, a line per case and variant; all_scores: case name -> scores as of `rows_of`."""
    lines = [
        "| case | paper | variant | inside | worst a6 | worst k1 | median a6 | median k1 | exact support | bound a6 "
        "| verdict |", "|---|---|---|---|---|---|---|---|---|---|---|"]
    for name, rows in all_scores.items():
        case = CASES[name]
        for variant, s in zip(case.variants, rows, strict=True):
            exact = f"{s['exact_support']}/{s['windows']}" if variant.library == "quadratic" else "-"
            node = f" (+{s['over_node_inside']}/{s['over_node']} over nodes)" if s["over_node"] else ""
            lines.append(
                f"| {name} | {case.paper} | {variant.name} | {s['inside']}/{s['counted']}{node} "
                f"| {percent(s['worst_a6'])} | {percent(s['worst_k1'])} | {percent(s['median_a6'])} "
                f"| {percent(s['median_k1'])} | {exact} | {percent(s['bound_a6'])} | {s['verdict']} |")
    return lines


def xi_lines(results: list[Result]) -> list[str]:
    """Return the coefficients Xi of the whole constant flight with the lowest seed, printed as the paper's matrix."""
    result = min(results, key=lambda r: r.seed)
    lines = [f"{'Xi':>16} {'theta_dot':>12} {'theta_ddot':>12} {'beta_dot':>12}"]
    for term, row in zip(polynomial(2), result.xi, strict=True):
        lines.append(f"{term:>16} " + " ".join(f"{x:>12.6g}" for x in row))
    return lines


def rows_of(case: Case, results: list[Result], outcomes: dict[Job, Any]) -> list[dict[str, Any]]:
    """Return the scores of a case, one dict per variant, with bound and verdict; outcomes: job -> its result."""
    rows = [score(case, k, results) for k in range(len(case.variants))]
    for k, (variant, row) in enumerate(zip(case.variants, rows, strict=True)):
        row.update(variant=variant.name, bound_a6=outcomes[FloorJob(case.nominal, variant.window)]
                   if variant.suite == "flight" else None, verdict=verdict(case, k, row))
    return rows


def work(job: Job) -> Any:
    """Run a job: return a flight's results, a bound or a dispersed flight."""
    if isinstance(job, VehicleJob):
        return fly_job(job)
    return noise_floor(job) if isinstance(job, FloorJob) else confidence.fly_band(job)


def jobs_of(names: list[str], vehicles: Sequence[str], seeds: int) -> dict[str, list[Job]]:
    """Return experiment -> jobs: flights and bounds of cases `names`, dispersed flights of `vehicles`; `seeds` each."""
    flights = vehicle_jobs(names, seeds)
    jobs: dict[str, list[Job]] = {name: [*(job for job in flights if name in job.cases), *floors_of(CASES[name])]
                                  for name in names}
    return jobs | {f"{CONFIDENCE}, {name}": [*confidence.band_jobs(name, seeds)] for name in vehicles}


def in_order(jobs: dict[str, list[Job]]) -> list[Job]:
    """Return all jobs, each once, in the order to run: a filter flight, a regression flight, bounds, the other flights.

    The first two make two processes compile the filter's and the regressions' kernels at the same time.
    """
    flights = [job for each in jobs.values() for job in each if not isinstance(job, FloorJob)]
    floors = [job for each in jobs.values() for job in each if isinstance(job, FloorJob)]
    warm = confidence.band_jobs(confidence.VEHICLES[0], 1)[:1]
    return list(dict.fromkeys([*warm, flights[0], *floors, *flights[1:]]))


def reproduce(case: str, seeds: int, out: str, say: Callable[[str], None] = lambda line: None) -> str:
    """Run one experiment or all, on all cores, the paper's own first; return the text to print.

    Figures, `table.md` and `results.json` are in the folder `out` as soon as an experiment is done, and `say` prints a
    line: an interruption loses only the experiments that are not done.
    """
    names = list(CASES) if case == "all" else [case] if case in CASES else []
    folder = make_folder(out)
    needed = jobs_of(names, confidence.VEHICLES if case in ("all", CONFIDENCE) else (), seeds)
    jobs, outcomes = in_order(needed), dict[Job, Any]()
    head = [f"launchid reproduce --case {case} --seeds {seeds}", ""]
    scores: dict[str, list[dict[str, Any]]] = {}
    bands: dict[str, list[confidence.Band]] = {}
    figures: list[str] = []

    def done(number: int, outcome: Any) -> None:
        """Note a job's outcome, and show each experiment that it completes."""
        outcomes[jobs[number]] = outcome
        for name, its in list(needed.items()):
            if all(job in outcomes for job in its):
                del needed[name]
                drawn = show(name, its)
                figures.extend(drawn)

    def show(name: str, its: list[Job]) -> list[str]:
        """Write tables and figures of an experiment, and say that it is done; return the figures' names."""
        if name in CASES:
            results = sorted((outcomes[job][name] for job in its if isinstance(job, VehicleJob)),
                             key=lambda result: (result.delta, result.seed))
            if name == "constant":
                head.extend([*xi_lines(results), ""])
            scores[name] = rows_of(CASES[name], results, outcomes)
            write_tables(folder, head, scores, bands)
            drawn, first = draw(_paper_figures, folder, name, results), scores[name][0]
            say(f"{name}: {first['verdict'] or 'done'}, {first['inside']} of {first['counted']} windows within the "
                f"claim's tolerance; {', '.join(drawn)}")
            return drawn
        vehicle = name.removeprefix(f"{CONFIDENCE}, ")
        bands[vehicle] = [outcomes[job] for job in its]
        write_tables(folder, head, scores, bands)
        drawn = draw(_confidence_figures, folder, {vehicle: bands[vehicle]})
        say(f"{name}: done; {', '.join(drawn)}")
        return drawn

    run_jobs(jobs, work, chunk=1, progress=Counter(len(jobs), "flights"), done=done)
    text = write_tables(folder, head, scores, bands)
    return "\n".join([*text, "", f"written to {folder}: table.md, results.json, "
                      f"{', '.join(dict.fromkeys(figures))}"])


def write_tables(folder: Path, head: list[str], scores: dict[str, list[dict[str, Any]]],
                 bands: dict[str, list[confidence.Band]]) -> list[str]:
    """Write `table.md` and `results.json` of the finished experiments to `folder`; return the lines of the table."""
    scores = {name: scores[name] for name in CASES if name in scores}
    text = list(head)
    if scores:
        text += table_lines(scores)
        text += ["", "inside: windows within the claim's tolerance (nodes of a piecewise linear profile apart); errors "
                 "are relative to the", "truth at the window's centre; bound a6: median Cramer-Rao bound of those "
                 "windows, below which no unbiased method can go."]
    if bands:
        text += ["", *confidence_lines(bands)]
    write_text(folder / "table.md", [line + "\n" for line in text])
    write_text(folder / "results.json", [json_text(scores), "\n"])
    return text


def confidence_lines(bands: dict[str, list[confidence.Band]]) -> list[str]:
    """Return the confidence range's table, a line per vehicle (vertices and random delta, flight sensors)."""
    lines = ["| confidence range | flights | tracked 95 % intervals cover | half-width of a6, k1 after 30 s (median) "
             "| out-of-range alarms | lost |", "|---|---|---|---|---|---|"]
    for name, flown in bands.items():
        s = confidence.summary(name, flown)
        lines.append(f"| {name} | {s['flights']} | {s['coverage']:.3f} | {percent(float(s['half_width_a6']))}, "
                     f"{percent(float(s['half_width_k1']))} of the box's 25 % | {s['alarms']:.0f} | {s['lost']:.0f} |")
    return lines


def draw(figures: Callable[..., list[str]], *what: Any) -> list[str]:
    """Call `figures(*what)`; return the file names drawn, without matplotlib one line that says how to install it."""
    try:
        return figures(*what)
    except ImportError:
        return ["no figures (pip install 'launchid[plots]' draws them)"]


def _paper_figures(folder: Path, name: str, results: list[Result]) -> list[str]:
    from . import paper_figures as plots
    return plots.paper_figures(folder, name, results)


def _confidence_figures(folder: Path, bands: dict[str, list[confidence.Band]]) -> list[str]:
    from . import confidence_figures as figures
    return figures.confidence_figures(folder, bands)
