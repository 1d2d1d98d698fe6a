"""The result of `compare`: a log beside one or several nominals."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sim.nominal import Nominal
from sim.result import Columns

from ..chi_square import quantile
from ..comparison.flown import FLOWN_CHANNELS, Dispersed
from ..comparison.frequency_response import BIASED, COHERENT, DECIBEL, Response, decibels_and_degrees
from ..comparison.prediction import HORIZONS, NO_STATISTICS, Predictions, Statistics, statistics
from ..formatting import json_number
from ..log.detect import DataCheck
from ..log.log import Log
from ..log.table import UNITS
from .answer import Answer, flat
from .headline import BEYOND_NOISE, closing

if TYPE_CHECKING:
    from sim.result import Figure

NUMBER_FORMATS = {"fit": ".2f", "noise_fit": ".2f", "rms": ".3g", "largest": ".3g", "tic": ".4f", "bias": ".2f",
                  "variance": ".2f", "covariance": ".2f"}


@dataclass(frozen=True, eq=False)
class Beside:
    """A log compared with one nominal, which `label` names; flown (channel -> values (rows,)) and dispersed are None if
    it cannot fly the log."""

    label: str
    nominal: Nominal
    predictions: Predictions
    flown: dict[str, np.ndarray] | None
    dispersed: Dispersed | None
    responses: list[Response]


@dataclass(frozen=True, eq=False)
class Comparison(Answer):
    """Result of `compare`: a log, without what the data check masks, compared with nominals in the order given."""

    log: Log
    nominals: list[Beside]
    report: dict[str, Any]
    warnings: tuple[str, ...] = ()

    def summary(self) -> str:
        lines = [f"{self.log.path}: measured beside {', '.join(each.label for each in self.nominals)}",
                 "fit in %, 100 is exact; noise: what the declared noise leaves of it where the nominal is right; TIC: "
                 "Theil's inequality coefficient, 0 is exact, with its shares of bias, variance and covariance",
                 f"{'channel':<10}{'':<12}{'nominal':<20}{'fit':>8}{'noise':>8}{'rms':>11}{'largest':>11}  {'unit':<6}"
                 f"{'TIC':>7}{'bias':>7}{'var.':>7}{'cov.':>7}"]
        for row in self._rows():
            fit, noise, rms, largest, *shares = ("-" if row[key] is None else f"{row[key]:{form}}"
                                                 for key, form in NUMBER_FORMATS.items())
            lines.append(f"{row['channel']:<10}{row['of']:<12}{row['nominal']:<20}{fit:>8}{noise:>8}{rms:>11}"
                         f"{largest:>11}  {UNITS[row['channel']]:<6}" + "".join(f"{share:>7}"
                                                                                         for share in shares))
        return "\n".join([*lines, *self._dispersion_lines(), *self.response_lines(), *self._verdict_lines(),
                          *closing(self.report)])

    def _rows(self) -> list[dict[str, Any]]:
        """Return a dict of statistics for each channel, prediction or flight, and nominal."""
        rows = []
        for channel in FLOWN_CHANNELS:
            for of in (*(f"{h:g}" for h in HORIZONS), "flown"):
                for each in self.report["nominals"]:
                    said = each["channels"].get(channel, {"ahead": {}})
                    found = said.get("flown") if of == "flown" else said["ahead"].get(of)
                    if found is not None:
                        rows.append({"channel": channel, "of": of if of == "flown" else f"{of} s ahead",
                                     "nominal": each["nominal"], "noise_fit": None, **found})
        return rows

    def _verdict_lines(self) -> list[str]:
        """Return a line for each nominal: its error in the longest prediction over what declared noise makes."""
        lines, horizon = [], f"{HORIZONS[-1]:g}"
        for each in self.report["nominals"]:
            found = {name: said["ahead"].get(horizon) for name, said in each["channels"].items()}
            over = {name: (100.0 - one["fit"]) / (100.0 - one["noise_fit"]) for name, one in found.items()
                    if one is not None and None not in (one["fit"], one["noise_fit"]) and one["noise_fit"] < 100.0}
            if over:
                beyond = "; `launchid diagnose` looks for the cause" if max(over.values()) > BEYOND_NOISE else ""
                ratios = ", ".join(f"{name} {x:.2f}" for name, x in over.items())
                lines.append(f"{each['nominal']}, {horizon} s ahead, error over what its declared noise makes (1: as "
                             f"good as that allows; less: it declares too much): {ratios}{beyond}")
        return lines

    def _dispersion_lines(self) -> list[str]:
        lines = []
        for each in self.nominals:
            if each.dispersed is None:
                continue
            places = "; ".join(f"{name} {100.0 * place.outside:.0f} %, peak at {100.0 * place.peak:.0f} %"
                               for name, place in each.dispersed.places.items())
            lost = f"; {each.dispersed.lost} of them were lost" if each.dispersed.lost else ""
            lines.append(f"among dispersed flights of {each.label}{lost}: share of the time outside their 5..95 % (10 "
                         f"% is usual), and the share of flights whose peak is below the log's: {places}")
        return lines

    def response_lines(self) -> list[str]:
        """Return a line for each pair and instrument: at which frequencies the response is coherent, and at how many of
        them each nominal is in its 95 % region."""
        lines: dict[str, list[str]] = {}
        for each in self.nominals:
            for response in each.responses:
                usable = response.coherence > COHERENT
                way = f"instrument {response.instrument}" if response.instrument else "of the input itself"
                span = response.frequency[usable]
                head = f"{response.source} -> {response.to}, {way}: coherence above {COHERENT:g} " + (
                    f"at {usable.sum()} frequencies, {span[0]:.2g} to {span[-1]:.2g} Hz" if usable.any() else "nowhere")
                said = lines.setdefault(head, [])
                if usable.any() and np.isfinite(response.nominal[usable]).all():
                    said.append(f"{each.label} at {100.0 * np.mean(within(response)[usable]):.0f} %")
        made = [head + (f"; inside the 95 % region of the measured: {', '.join(said)}" if said else "")
                for head, said in lines.items()]
        return [*made, f"of the input itself: {BIASED}"] if made else made

    def columns(self) -> Columns:
        return flat(self._rows())

    def _figure(self) -> "Figure":
        from .comparison_figures import comparison_figure
        return comparison_figure(self)

    def figures(self) -> dict[str, "Figure"]:
        """Return file name -> matplotlib figure, of what can be drawn: comparison, dispersions, responses."""
        from .comparison_figures import COMPARISON_FIGURES
        return {name: figure for name, make in COMPARISON_FIGURES.items() if (figure := make(self)) is not None}

    def write_report(self, folder: str | Path) -> None:
        """Write report.html, compare.json and the figures into a folder."""
        from .comparison_page import write_comparison
        write_comparison(self, folder)


def labels(nominals: Sequence[Nominal]) -> list[str]:
    """Return a distinct name for each nominal: its file's name, else its path, else that with its number."""
    paths = [each.path or each.name for each in nominals]
    for names in ([Path(path).stem for path in paths], paths):
        if len(set(names)) == len(names):
            return names
    return [f"{name} ({k})" for k, name in enumerate(names, start=1)]


def masked(log: Log, data: DataCheck) -> Log:
    """Return the log with NaN for stamps and values in which the data check finds a fault."""
    columns: dict[str, Any] = {name: np.where(mask, getattr(log, name), np.nan) for name, mask in data.masks.items()}
    return replace(log, t=np.where(data.usable, log.t, np.nan), **columns)


def within(response: Response) -> np.ndarray:
    """Return where (bins,) the nominal is in the joint 95 % region of measured gain and phase, as bool."""
    return np.asarray(np.abs(np.log(response.gain / response.nominal))**2 <= quantile(0.95, 2) * response.std**2)


# ---- the JSON


def report(log: Log, made: Sequence[Beside]) -> dict[str, Any]:
    """Return the compare JSON of a log: for each nominal statistics of its channels and its frequency responses."""
    return {"nominals": [{"nominal": each.label, "channels": {
        name: _channel(name, getattr(log, name), each) for name in FLOWN_CHANNELS
        if np.isfinite(getattr(log, name)).any()},
        "frequency_response": [_response(response) for response in each.responses]} for each in made]}


def _channel(name: str, measured: np.ndarray, each: Beside) -> dict[str, Any]:
    ahead = {}
    for horizon, found in each.predictions.get(name, {}).items():
        spread = float(np.nanstd(found.measured)) if np.isfinite(found.measured).any() else 0.0
        noise = 100.0 * (1.0 - found.noise / spread) if spread > 0.0 else math.nan
        ahead[f"{horizon:g}"] = {**_said(statistics(found.measured, found.predicted)), "noise_fit": json_number(noise)}
    place = None if each.dispersed is None else each.dispersed.places.get(name)
    return {"ahead": ahead,
            "flown": None if each.flown is None else _said(statistics(measured, each.flown[name])),
            "percentile": None if place is None else {
                "share_outside_90": json_number(place.outside), "peak": place.peak}}


def _said(found: Statistics) -> dict[str, float | None]:
    known = found if math.isfinite(found.rms) else NO_STATISTICS
    return {key: json_number(x) for key, x in known._asdict().items()}


def _response(of: Response) -> dict[str, Any]:
    gain, phase, nominal_gain, nominal_phase = decibels_and_degrees(of)
    return {"from": of.source, "to": of.to, "instrument": of.instrument, "frequency": of.frequency.tolist(),
            "gain_db": _list(gain), "gain_db_std": _list(DECIBEL * of.std), "phase_deg": _list(phase),
            "phase_deg_std": _list(np.degrees(of.std)), "coherence": _list(of.coherence),
            "nominal_gain_db": _list(nominal_gain), "nominal_phase_deg": _list(nominal_phase)}


def _list(x: np.ndarray) -> list[float | None]:
    return [json_number(value) for value in x.tolist()]
