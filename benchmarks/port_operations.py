"""Operations of the exported C, counted: its own source, compiled as C++ with numbers that count (port_counted.h)."""

import re
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from launchid.c_export.program import c_files
from launchid_core import Config, Sample

HERE = Path(__file__).parent
CXX = "g++"
COUNTED = ("loads", "stores", "sums", "products", "quotients", "roots")  # sums: additions and subtractions
OWN = "/* ---- what leaves"     # of launchid.c: what follows is not of an update
DRIVER = """
#include <stdio.h>

static launchid_estimator estimator;

int main(void)
{
    double v[7];
    launchid_state_reset(&estimator.state);
    while (scanf("%lf %lf %lf %lf %lf %lf %lf", &v[0], &v[1], &v[2], &v[3], &v[4], &v[5], &v[6]) == 7) {
        const launchid_sample s = {v[0], v[1], v[2], v[3], v[4], v[5], v[6]};
        counted_so_far = {};
        const int status = (int)launchid_state_update(&estimator.state, &estimator.work, &s);
        printf("%d %ld %ld %ld %ld %ld %ld\\n", status, (long)counted_so_far.loads, (long)counted_so_far.stores,
               (long)counted_so_far.sums, (long)counted_so_far.products, (long)counted_so_far.quotients,
               (long)counted_so_far.roots);
    }
    return 0;
}
"""


def counted_source(files: dict[str, str]) -> str:
    """Return an export's updates as one C++ source, its memory of `stored`, its variables of `real`, which count."""
    header, source = files["launchid.h"], files["launchid.c"]
    memory = header.index("/* ---- memory")
    header = header[:memory] + re.sub(r"\bdouble (\w+[\[;])", r"stored \1", header[memory:])
    kernels, rest = source[:source.index(OWN)], source[source.index("/* ---- the estimator"):]
    kernels = re.sub(r"(const )?double \*", lambda m: f"{m[1] or ''}stored *", kernels)
    kernels = re.sub(r"(static const) double (\w+\[\])", r"\1 stored \2", kernels)
    kernels = kernels.replace("{.number = x}", "{.number = x.v}").replace("union { double", "union { DOUBLE")
    kernels = kernels.replace("(double)INFINITY", "__builtin_inf()").replace("(double)NAN", '__builtin_nan("")')
    kernels = re.sub(r"\bdouble\b", "real", kernels).replace("union { DOUBLE", "union { double")
    update = rest[:rest.index("bool launchid_state_estimate")]
    kernels = kernels.replace('#include "launchid.h"', "")
    return f'#include "{HERE / "port_counted.h"}"\n{header}{kernels}{update}{DRIVER}'


def _counts(source: str, given: str) -> np.ndarray:
    """Compile and run the C++ source with this input; return the numbers that it prints, a row a line."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "counted.cpp").write_text(source, encoding="utf-8")
        subprocess.run([CXX, "-std=c++20", "-O0", "-ffp-contract=off", "-w", "counted.cpp", "-o", "counted"],
                       cwd=folder, check=True)
        done = subprocess.run(["./counted"], cwd=folder, input=given, capture_output=True, text=True, check=True)
    return np.array([[int(x) for x in line.split()] for line in done.stdout.splitlines()])


def operations(config: Config, samples: list[Sample]) -> tuple[np.ndarray, np.ndarray]:
    """Return status (n,) and counts of operations (n, 6), in the order of COUNTED, of each update."""
    text = "".join(" ".join(repr(float(x)) for x in sample) + "\n" for sample in samples)
    table = _counts(counted_source(c_files(config)), text)
    return table[:, 0], table[:, 1:]
