"""Operations of the exported C, counted: its own source, compiled as C++ with numbers that count (port_counted.h)."""

import re
import subprocess
import tempfile
from fractions import Fraction
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

KERNELS = {  # formulation whose source has it -> name -> call; m numbers in each of q columns
    "measured": {
        "scale_columns": "scale_columns(at, (Vector){norms, q})",
        "qr_factor": "(void)qr_factor(at, (Integers){order, q}, (Vector){norms, q}, 0.0)",
        "apply_q_transposed": "apply_q_transposed(at, (Vector){norms, q}, q, (Vector){y, m})",
        "solve_triangle": "solve_triangle(at, q, (Vector){y, m}, (Vector){norms, q})",
        "invert": "invert(q, q, (Integers){order, q}, (Matrix){other, q, 4 * q})"},
    "filtered": {"absorb_rows": "absorb_rows((Matrix){other, q, q}, at, q, m)"}}
KERNEL_DRIVER = """
#include <stdio.h>
#define MOST 65536

static stored numbers[MOST], other[MOST], norms[MOST], y[MOST];
static int64_t order[MOST];

int main(void)
{
    int kernel, m, q;
    while (scanf("%d %d %d", &kernel, &m, &q) == 3) {
        const Matrix at = {numbers, q, m};
        for (int k = 0; k < q * m; k++) {  /* columns that shrink: none is exchanged */
            numbers[k].v = std::ldexp((double)((k * k * 13 + k * 7) % 101 - 50), -10 * (k / m));
            norms[k].v = y[k].v = 1.0;
        }
        for (int k = 0; k < q * q; k++) {
            other[k].v = (double)((k * k * 29 + k * 3) % 97 + 1);
        }
        for (int k = 0; k < q; k++) {
            order[k] = k;
        }
        counted_so_far = {};
        switch (kernel) {
CALLS        }
        printf("%ld %ld %ld %ld %ld %ld\\n", (long)counted_so_far.loads, (long)counted_so_far.stores,
               (long)counted_so_far.sums, (long)counted_so_far.products, (long)counted_so_far.quotients,
               (long)counted_so_far.roots);
    }
    return 0;
}
"""

FORMULAS = {  # of COUNTED without stores, for m numbers in each of q columns; qr_factor: 2 m loads more an exchange
    "scale_columns": ("3 m q + q", "m q + 3 q", "2 m q", "q", "q"),
    "qr_factor": ("3 m q^2 + 2 m q - q^3 + 2 q^2 + 5 q",
                  "3 m q^2/2 + m q/2 - q^3/2 + 4 q^2 + 9 q/2",
                  "3 m q^2/2 + 3 m q/2 - q^3/2 + 3 q^2/2", "2 q", "q"),
    "apply_q_transposed": ("4 m q - 2 q^2 + q", "2 m q - q^2 + 4 q", "2 m q - q^2", "0", "0"),
    "solve_triangle": ("q^2 + q", "q^2/2 - q/2", "q^2/2 - q/2", "q", "0"),
    "invert": ("q^3 - q^2/2 + q/2", "q^3/2 + q^2 - 3 q/2", "q^3/2 - q^2/2", "q^2/2 + q/2", "0"),
    "absorb_rows": ("2 m q^2 + m q + q^2", "m q^2 + 5 q^2/2 + 7 q/2", "m q^2 + m q + q^2/2 + q/2", "2 q", "q")}
AT_MOST = ("qr_factor",)  # columns go four at a time where there are four, which saves loads and sums


def value(formula: str, m: int, q: int) -> Fraction:
    """The value of a formula such as `3 m q^2/2 + q`."""
    of = {"m": Fraction(m), "q": Fraction(q)}
    total = Fraction(0)
    for sign, term in re.findall(r"([+-]?) ?([^+-]+)", formula):
        top, _, bottom = term.strip().partition("/")
        product = Fraction(1, int(bottom or 1))
        for factor in top.split():
            base, _, power = factor.partition("^")
            product *= (of[base] if base in of else Fraction(int(base))) ** int(power or 1)
        total += -product if sign == "-" else product
    return total


def counted_source(files: dict[str, str], driver: str = DRIVER) -> str:
    """One C++ source of an export: arrays of `stored`, variables of `real`, updates only."""
    header, source = files["launchid.h"], files["launchid.c"]
    memory = header.index("/* ---- memory")
    header = header[:memory] + re.sub(r"\bdouble (\w+\[)", r"stored \1", header[memory:])
    kernels, rest = source[:source.index(OWN)], source[source.index("/* ---- the estimator"):]
    kernels = re.sub(r"(const )?double \*", lambda m: f"{m[1] or ''}stored *", kernels)
    kernels = re.sub(r"(static const) double (\w+\[\])", r"\1 stored \2", kernels)
    kernels = kernels.replace("{.number = x}", "{.number = x.v}").replace("union { double", "union { DOUBLE")
    kernels = kernels.replace("(double)INFINITY", "__builtin_inf()").replace("(double)NAN", '__builtin_nan("")')
    kernels = re.sub(r"\bdouble\b", "real", kernels).replace("union { DOUBLE", "union { double")
    update = rest[:rest.index("bool launchid_state_estimate")]
    kernels = kernels.replace('#include "launchid.h"', "")
    return f'#include "{HERE / "port_counted.h"}"\n{header}{kernels}{update}{driver}'


def _counts(source: str, given: str) -> np.ndarray:
    """Numbers that the program prints, a row a line."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "counted.cpp").write_text(source, encoding="utf-8")
        subprocess.run([CXX, "-std=c++20", "-O0", "-ffp-contract=off", "-w", "counted.cpp", "-o", "counted"],
                       cwd=folder, check=True)
        done = subprocess.run(["./counted"], cwd=folder, input=given, capture_output=True, text=True, check=True)
    return np.array([[int(x) for x in line.split()] for line in done.stdout.splitlines()])


def operations(config: Config, samples: list[Sample]) -> tuple[np.ndarray, np.ndarray]:
    """Status (n,) and counts (n, 6), in the order of COUNTED, of each update."""
    text = "".join(" ".join(repr(float(x)) for x in sample) + "\n" for sample in samples)
    table = _counts(counted_source(c_files(config)), text)
    return table[:, 0], table[:, 1:]


def kernel_operations(formulation: str, config: Config, sizes: list[tuple[int, int]]) -> dict[str, np.ndarray]:
    """Counts (n, 6) of each kernel of KERNELS for the sizes (m, q); config: any of the formulation."""
    calls = KERNELS[formulation]
    cases = "".join(f"        case {k}:\n            {call};\n            break;\n"
                    for k, call in enumerate(calls.values()))
    source = counted_source(c_files(config, general=True), KERNEL_DRIVER.replace("CALLS", cases))
    given = "".join(f"{k} {m} {q}\n" for k in range(len(calls)) for m, q in sizes)
    return dict(zip(calls, np.split(_counts(source, given), len(calls)), strict=True))
