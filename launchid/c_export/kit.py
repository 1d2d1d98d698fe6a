"""The kit that an export has beside the estimator: vectors and their checker, an example, Makefile, a target, a
README."""

from launchid_core import Config, Status

from .program import c_files, template
from .vectors import Flight, header
from .wrappers import wrappers

CONSTANT_FILES = ("example.c", "eva.c", "Makefile", "target.c", "target.ld")  # the same for every configuration


def exported(config: Config, flights: list[Flight]) -> dict[str, str]:
    """File name -> text of all that `launchid export-c` writes; the Python estimator answers to the flights."""
    statuses = ", ".join(f"LAUNCHID_{status.name}" for status in Status)
    vectors = {"flights": len(flights), "samples": sum(map(len, flights))}
    return (c_files(config, vectors=vectors) | {"check.c": template("check.c", {"statuses": statuses})}
            | {name: template(name, {}) for name in CONSTANT_FILES} | {"vectors.h": header(config, flights)}
            | wrappers(config))
