"""The kit that an export has beside the estimator: vectors and their checker, an example, Makefile, a target, a
README."""

from launchid_core import Config, Sample

from .program import c_files, template
from .vectors import header
from .wrappers import wrappers

PLAIN = ("check.c", "example.c", "Makefile", "target.c", "target.ld")  # the same for every configuration


def exported(config: Config, samples: list[Sample]) -> dict[str, str]:
    """File name -> text of all that `launchid export-c` writes; the Python estimator answers to the samples."""
    return (c_files(config) | {name: template(name, {}) for name in PLAIN} | {"vectors.h": header(config, samples)}
            | wrappers(config))
