"""The picture that a report opens with: what was measured against what was predicted, before and after.

Every prediction starts from the state as corrected at its row and runs free over the horizon.
"""

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from ..data.record import CHANNELS
from ..judge.closed_loop import rms
from ..judge.diagnosis import Diagnosis
from ..judge.gain import Trained, within
from ..model.point import prediction_errors
from ..search.foresight import SPACING, settling, spans
from ..search.profile import Model
from .canvas import AFTER, BEFORE, EXTENDED, MEASURED, SYMBOLS, UNITS, axes_of, mark_times
from .words import predicts_better


@dataclass(frozen=True, eq=False)
class Predicted:
    """A model's errors (s, 3) of predicting a horizon ahead, nan where it cannot be said; measured less predicted."""

    label: str
    error: np.ndarray


def predicted(made: Diagnosis) -> list[Predicted]:
    """The nominal with the a6 and k1 of its tolerance, and the model with its causes where that predicts better."""
    found = made.selection
    assert found is not None
    before = found.nominal if found.model.causes or found.calm is None else found.calm
    models = [Predicted("nominal", _errors(before, is_nominal=True))]
    if found.model is not before and predicts_better(made):
        models.append(Predicted(EXTENDED[made.verdict], _errors(found.model)))
    return models


def _errors(model: Model, is_nominal: bool = False) -> np.ndarray:
    record, own = model.fit.record, Trained(model.fit.point, model.fit.filter)
    own = within(record, own, None) if is_nominal else own
    return prediction_errors(record, own.filter, own.point, (spans(record)[-1],), SPACING)[:, 0]


def misfit(made: Diagnosis) -> Figure | None:
    """The change of a channel over the horizon, measured and predicted, and the error; of the channel whose errors
    are the largest beside its changes. None where the log is shorter than two horizons."""
    if made.selection is None or made.record is None:
        return None
    models, record = predicted(made), made.record
    rows, ahead = max(1, round(SPACING / record.period)), max(1, round(spans(record)[-1] / record.period))
    start = rows * np.arange(len(models[0].error))
    inside = (start + ahead < record.rows) & (start * record.period >= settling(record))
    start = start[inside]
    change = record.z[start + ahead] - record.z[start]
    errors = [model.error[inside] for model in models]
    shares = {k: rms(errors[0][:, k]) / rms(change[:, k]) for k in (CHANNELS.index(name) for name in record.channels)
              if np.isfinite(errors[0][:, k] + change[:, k]).any() and rms(change[:, k]) > 0.0}
    if not shares:
        return None
    k = max(shares, key=lambda channel: shares[channel])
    name, unit = CHANNELS[k], UNITS[CHANNELS[k]]
    t = record.t[start + ahead] + record.shift
    figure, axes = axes_of(2, 1, (9.4, 3.7), sharex=True)
    above, below = axes[:, 0]
    above.plot(t, change[:, k], label="measured", **MEASURED)
    for model, error in zip(models, errors, strict=True):
        style = BEFORE if model is models[0] else AFTER
        above.plot(t, change[:, k] - error[:, k], label=f"predicted, {model.label}", **style)
        below.plot(t, error[:, k], label=f"{model.label}: {rms(error[:, k]):.2g} {unit} rms", **style)
    above.set_ylabel(f"change of {SYMBOLS[name]}\nin {spans(record)[-1]:g} s [{unit}]", fontsize=9)
    below.set_ylabel(f"measured less\npredicted [{unit}]", fontsize=9)
    below.set_xlabel("t [s]")
    for axis in (above, below):
        axis.legend(fontsize=8, ncol=3, loc="lower left", bbox_to_anchor=(0.0, 0.98), frameon=False)
        mark_times(axis, made, named=axis is above)
    return figure
