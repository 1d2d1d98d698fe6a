"""Compose all files of `launchid export-c`.

They are the estimator in C, its vectors and their checker, an example, a Makefile, a target, a README, and wrappers for
cFS, F Prime and Simulink.
The wrappers are made from one description: their inputs are the fields of a sample, their outputs OUTPUTS.
"""

from launchid_core import Config, Sample, Status

from .kinds import literal
from .program import c_files, template
from .vectors import Flight, header

CONSTANT_FILES = ("example.c", "eva.c", "Makefile", "target.c", "target.ld")  # the same for every configuration
SAMPLE_UNITS = {"t": "s", "theta": "rad", "theta_dot": "rad/s", "beta": "rad", "theta_ddot": "rad/s^2",
                "beta_cmd": "rad", "gamma": "rad"}
OUTPUTS = (  # name, unit, of a launchid_estimate
    ("t_end", "s", "t_end"), ("a6", "1/s^2", "a6"), ("k1", "1/s^2", "k1"), ("a6_std", "1/s^2", "a6_std"),
    ("k1_std", "1/s^2", "k1_std"), ("tracked_a6", "1/s^2", "tracked.a6"), ("tracked_k1", "1/s^2", "tracked.k1"),
    ("tracked_a6_std", "1/s^2", "tracked.a6_std"), ("tracked_k1_std", "1/s^2", "tracked.k1_std"),
    ("wind", "rad", "wind"))
FRAMES = ("launchid_cfs.c", "Launchid.fpp", "Launchid.hpp", "Launchid.cpp", "launchid_sfun.c")


def exported(config: Config, flights: list[Flight]) -> dict[str, str]:
    """Return file name -> text of all that `launchid export-c` writes; `flights` are the vectors that check it."""
    statuses = ", ".join(f"LAUNCHID_{status.name}" for status in Status)
    vectors = {"flights": len(flights), "samples": sum(map(len, flights))}
    return (c_files(config, vectors=vectors) | {"check.c": template("check.c", {"statuses": statuses})}
            | {name: template(name, {}) for name in CONSTANT_FILES} | {"vectors.h": header(config, flights)}
            | frames(config))


def frames(config: Config) -> dict[str, str]:
    """Return file name -> text of the wrappers for cFS, F Prime and Simulink (FRAMES)."""
    fields = Sample._fields
    values: dict[str, object] = {
        "n_in": len(fields), "n_out": len(OUTPUTS), "period": literal(config.sample_period),
        "sample_members": "".join(f"    double {name};  /* {SAMPLE_UNITS[name]} */\n" for name in fields),
        "estimate_members": "".join(f"    double {name};  /* {unit} */\n" for name, unit, _ in OUTPUTS),
        "sample_of_message": ", ".join(f"message->{name}" for name in fields),
        "sample_of_input": ", ".join(f"*u[{k}]" for k in range(len(fields))),
        "sample_of_port": ", ".join(fields),
        "fill_message": "".join(f"        app.out.{name} = estimate.{path};\n" for name, _, path in OUTPUTS),
        "fill_output": "".join(f"        y[{k}] = estimate.{path};\n" for k, (_, _, path) in enumerate(OUTPUTS)),
        "fill_telemetry": "".join(f"    this->tlmWrite_{name}(estimate.{path});\n" for name, _, path in OUTPUTS),
        "fpp_arguments": "".join(f"    {name}: F64 @< {SAMPLE_UNITS[name]}\n" for name in fields),
        "fpp_telemetry": "".join(f"    telemetry {name}: F64 @< {unit}\n" for name, unit, _ in OUTPUTS),
        "cpp_arguments": ",\n        ".join(f"F64 {name}" for name in fields)}
    return {name: template(name, values) for name in FRAMES}
