"""The identity of a campaign: everything that decides its table and its verdict, and nothing else."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np

from launchid_core import __version__
from sim.nominal import Nominal

FLIGHTS_FORMAT = "launchid flights 1"
NOT_FLOWN = ("name", "diagnosis")  # of a nominal: how it is called and judged


@dataclass(frozen=True)
class Definition:
    """Flights of the seeds `seed` ... `seed + flights - 1`, and what they are to prove."""

    nominal: Nominal
    seed: int
    flights: int
    requirements: Sequence[str]
    planned: bool

    def as_json(self) -> dict[str, Any]:
        """The definition as it stands in the folder's campaign.json."""
        return {"format": FLIGHTS_FORMAT, "version": __version__, "nominal": self.nominal.name,
                "nominal_sha256": digest_of(self.nominal), "seed": self.seed, "flights": self.flights,
                "requirements": list(self.requirements), "stop": "never" if self.planned else "decided"}


def digest_of(nominal: Nominal) -> str:
    """The same for nominals that fly the same, wherever their files stand."""
    flown = {key.name: getattr(nominal, key.name) for key in fields(nominal) if key.name not in NOT_FLOWN}
    return hashlib.sha256(_text(flown).encode()).hexdigest()


def _text(part: Any) -> str:
    """The text of every number of a part, to the last bit, without the paths of files."""
    if is_dataclass(part):
        part = {key.name: getattr(part, key.name) for key in fields(part)}
    if isinstance(part, dict):
        return f"{{{','.join(f'{key}={_text(value)}' for key, value in part.items() if key != 'path')}}}"
    if isinstance(part, np.ndarray):
        return repr(part.tolist())
    if isinstance(part, tuple | list):
        return f"[{','.join(map(_text, part))}]"
    return repr(part)
