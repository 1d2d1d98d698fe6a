"""`launchid reproduce`: campaign, verdict table, figures, everything into one folder."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from launchid_core import polynomial
from sim.files import make_folder, write_text
from sim.nominal import built_in, load_nominal

from ..bound.flights import flight_bound
from ..identification.windows import number
from ..monte_carlo.campaign import run_jobs
from . import confidence
from .cases import CASES, CONFIDENCE, Case, Variant
from .flights import A6, EXACT, K1, NODE, TRUE_A6, TRUE_K1, VALID, Result, case_jobs, fly_job

BOUND_SEEDS = 3  # the bound varies by a percent between flights


def progress_bar(total: int) -> Any:
    """tqdm on a terminal, if installed; otherwise something silent with the same `update`."""
    try:
        from tqdm import tqdm
    except ImportError:
        tqdm = None
    if tqdm is None or not sys.stderr.isatty():
        class Silent:
            def update(self, n: int) -> None: ...
            def close(self) -> None: ...
        return Silent()
    return tqdm(total=total, unit="flight", file=sys.stderr)


def score(case: Case, variant: int, results: list[Result]) -> dict[str, Any]:
    """Worst and median errors of one variant over all windows of all flights, and the share inside the tolerance."""
    table = np.concatenate([result.tables[variant] for result in results])
    # a window over a node is judged apart only on clean data: under sensor noise the node is not what shows
    node = (table[:, NODE] == 1) & (case.variants[variant].suite == "ideal")
    errors = np.abs(table[:, [A6, K1]] - table[:, [TRUE_A6, TRUE_K1]])
    truth = np.abs(table[:, [TRUE_A6, TRUE_K1]])
    tolerance = np.maximum(case.relative * truth, case.absolute)
    inside = (errors <= tolerance).all(axis=1) & (table[:, VALID] == 1)
    relative = errors / np.maximum(truth, case.absolute / case.relative if case.absolute else 0.0)
    clear = ~node

    def worst(values: np.ndarray) -> float | None:
        return number(float(np.max(values))) if len(values) and np.isfinite(values).all() else None

    return {
        "windows": len(table), "valid": int(np.sum(table[:, VALID] == 1)), "inside": int(np.sum(inside & clear)),
        "counted": int(np.sum(clear)), "over_node": int(np.sum(node)), "over_node_inside": int(np.sum(inside & node)),
        "over_node_worst": worst(relative[node]), "exact_support": int(np.sum(table[:, EXACT])),
        "worst_a6": worst(relative[clear, 0]), "worst_k1": worst(relative[clear, 1]),
        "median_a6": number(float(np.nanmedian(relative[clear, 0]))),
        "median_k1": number(float(np.nanmedian(relative[clear, 1]))),
        "lost": sum(result.lost for result in results), "flights": len(results)}


def holds(case: Case, scores: dict[str, Any]) -> bool:
    """The paper's claim: every window off the nodes inside the tolerance, no flight lost, support exact where asked."""
    exact = not case.support or scores["exact_support"] == scores["windows"]
    return bool(scores["inside"] == scores["counted"] and scores["lost"] == 0 and exact)


def percent(x: float | None) -> str:
    """A share as a percentage for a table."""
    return "-" if x is None else f"{100 * x:.2g} %"


def noise_floor(case: Case, variant: Variant) -> float | None:
    """Median Cramer-Rao bound of a6 for a variant on flight sensors, relative."""
    if variant.suite != "flight":
        return None
    nominal = load_nominal(built_in(case.nominal))
    return float(np.median(np.concatenate([flight_bound(nominal, variant.window, seed).a6
                                           for seed in range(BOUND_SEEDS)])))


def verdict(case: Case, k: int, scores: dict[str, Any]) -> str:
    """The last cell of a table's row: the claim is judged for the paper's variant, companions inform."""
    if case.name == "tuning":
        return ""
    if k == 0:
        return "holds" if holds(case, scores) else "FAILS"
    return "companion"


def table_lines(all_scores: dict[str, list[dict[str, Any]]]) -> list[str]:
    """The table as Markdown."""
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
    """Xi of the whole constant flight, printed as the paper's matrix."""
    result = min(results, key=lambda r: r.seed)
    lines = [f"{'Xi':>16} {'theta_dot':>12} {'theta_ddot':>12} {'beta_dot':>12}"]
    for term, row in zip(polynomial(2), result.xi, strict=True):
        lines.append(f"{term:>16} " + " ".join(f"{x:>12.6g}" for x in row))
    return lines


def reproduce(case: str, seeds: int, out: str) -> str:
    """Run one case or all, write figures, `table.md` and `results.json` into `out`; returns the text to print."""
    names = list(CASES) if case == "all" else [case] if case in CASES else []
    folder = make_folder(out)
    jobs = case_jobs(names, seeds)
    vehicles = confidence.VEHICLES if case in ("all", CONFIDENCE) else ()
    bar = progress_bar(len(jobs))
    for job in jobs[:1]:  # compiles here what every worker that is about to be forked needs
        fly_job(job)
    flown = run_jobs(jobs, fly_job, progress=bar.update)
    bar.close()
    results: dict[str, list[Result]] = {name: [] for name in names}
    for job, result in zip(jobs, flown, strict=True):
        results[job.name].append(result)
    bands = {name: run_jobs(confidence.band_jobs(name, seeds), confidence.fly_band) for name in vehicles}
    scores = {}
    for name in names:
        scores[name] = [score(CASES[name], k, results[name]) for k in range(len(CASES[name].variants))]
        for k, (variant, row) in enumerate(zip(CASES[name].variants, scores[name], strict=True)):
            row.update(variant=variant.name, bound_a6=noise_floor(CASES[name], variant),
                       verdict=verdict(CASES[name], k, row))
    text = [f"launchid reproduce --case {case} --seeds {seeds}", ""]
    if "constant" in names:
        text += [*xi_lines(results["constant"]), ""]
    if names:
        text += table_lines(scores)
        text += ["", "inside: windows within the claim's tolerance (nodes of a piecewise linear profile apart); errors "
                 "are relative to the", "truth at the window's centre; bound a6: median Cramer-Rao bound of those "
                 "windows, below which no unbiased method can go."]
    if bands:
        text += ["", *confidence_lines(bands)]
    write_text(folder / "table.md", [line + "\n" for line in text])
    write_text(folder / "results.json", [json.dumps(scores, indent=1), "\n"])
    figures = draw(folder, results, bands)
    return "\n".join([*text, "", f"written to {folder}: table.md, results.json, {', '.join(figures)}"])


def confidence_lines(bands: dict[str, list[confidence.Band]]) -> list[str]:
    """The confidence range as a table (vertices and random vehicles, flight sensors, 100 Hz, 1 s windows)."""
    lines = ["| confidence range | flights | tracked 95 % intervals cover | half-width of a6, k1 after 30 s (median) "
             "| out-of-range alarms | lost |", "|---|---|---|---|---|---|"]
    for name, flown in bands.items():
        s = confidence.summary(name, flown)
        lines.append(f"| {name} | {s['flights']} | {s['coverage']:.3f} | {percent(float(s['half_width_a6']))}, "
                     f"{percent(float(s['half_width_k1']))} of the box's 25 % | {s['alarms']:.0f} | {s['lost']:.0f} |")
    return lines


def draw(folder: Path, results: dict[str, list[Result]], bands: dict[str, list[confidence.Band]]) -> list[str]:
    """All figures of the cases that ran; without matplotlib a line says how to get it."""
    try:
        from ..figures import plots
        from ..robustness import figures
    except ImportError:
        return ["no figures (pip install 'launchid[plots]' draws them)"]
    return plots.paper_figures(folder, results) + figures.confidence_figures(folder, bands)
