"""The C port: the same bits as the Python estimator, whatever it is fed and however it is compiled; of a state that it
saves, too."""

import dataclasses
import math
import re
import struct
import subprocess
import zlib
from pathlib import Path

import numba
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from ported import (
    CC,
    CONFIGS,
    KNOWN,
    MODES,
    ROUGH,
    SHARED,
    STRICT,
    as_text,
    built,
    filtered,
    flight,
    hostile,
    needs_compiler,
    replayed,
    some,
    written,
)

from launchid.main import main
from launchid_core import BANDS, Change, Config, Estimate, Estimator, Sample, Status
from launchid_core.model import OFFSETS
from launchid_core.order.entries import calls_of
from sim.nominal import load_nominal
from sim.onboard import onboard_model
from sim.sections import notch

NAN = math.nan
FILES = ("Launchid.cpp", "Launchid.fpp", "Launchid.hpp", "Makefile", "README.md", "launchid_cfs.c", "launchid_sfun.c",
         "check.c", "eva.c", "example.c", "launchid.c", "launchid.h", "replay.c", "target.c",
         "target.ld", "vectors.h")


def bits(x: float) -> str:
    """The bits of a double; all NaN are one."""
    return "nan" if math.isnan(x) else struct.pack(">d", x).hex()


def read(line: str) -> list[str]:
    """A line of the port's: hexadecimal floats as bits, whole numbers and words as they are."""
    return [bits(float.fromhex(word)) if re.match(r"-?(0x|nan|inf)", word) else word for word in line.split()]


def window_words(e: Estimate) -> list[str]:
    numbers = (e.t_start, e.t_end, e.a6, e.k1, e.a6_std, e.k1_std, e.a6_k1_corr, e.a6_dot, e.k1_dot, e.a6_bound,
               e.k1_bound, e.condition)
    words = ["window", str(int(e.status)), str(e.rows), str(e.gaps), *map(bits, numbers)]
    for value, active in zip(e.xi.ravel().tolist(), e.support.ravel().tolist(), strict=True):
        words += [bits(value), str(int(active))]
    tracked = e.tracked or (False, *(NAN,) * 5)
    offsets = [x for name in OFFSETS for x in e.offsets.get(name, (NAN, NAN))]
    servo = [x for each, shared in zip(e.actuator.values(), e.actuator_corr, strict=True)
             for x in (*each, shared)] if e.actuator else [NAN] * 9
    return [*words, str(int(tracked[0])), *(bits(x) for x in (
        *tracked[1:], e.wind, e.wind_std, *offsets, *servo, *(x for mode in e.modes for x in mode[1:])))]


def level_words(e: Estimate) -> list[list[str]]:
    if e.uncertainty is None or not e.uncertainty.valid:
        return []
    return [["level", name, str(BANDS.index(level.band) if level.band in BANDS else -1), str(int(level.in_range)),
             *map(bits, (level.delta, level.delta_std, *level.probability, level.out_since))]
            for name, level in (("a6", e.uncertainty.a6), ("k1", e.uncertainty.k1))]


def change_words(c: Change) -> list[str]:
    return ["change", c.parameter[0], *map(bits, (c.t, c.t_std, c.before, c.after, c.size, c.size_std, c.alarm)),
            str(int(c.final))]


def note_words(estimator: Estimator) -> list[str]:
    names = ("OUTLIER", "RESTART", "LEVEL_CLAMP", "CHANGE_WITHDRAWN")
    return ["notes", *(str(estimator.counts.get(name, 0)) for name in names)]


def expected(config: Config, samples: list[Sample]) -> list[list[str]]:
    """The estimator's answers, in the port's words."""
    estimator, said = Estimator(config), []
    for sample in samples:
        status = estimator.update(sample)
        said.append([str(int(status))])
        if status == Status.WINDOW_COMPLETE:
            estimate = estimator.estimate()
            said += [window_words(estimate), *level_words(estimate)]
    return [*said, *map(change_words, estimator.changes()), note_words(estimator)]


def assert_same(program: Path, config: Config, samples: list[Sample]) -> list[list[str]]:
    """Line by line; returns them."""
    wanted, got = expected(config, samples), [read(line) for line in replayed(program, samples)]
    for number, (ours, theirs) in enumerate(zip(wanted, got, strict=True)):
        assert ours == theirs, f"line {number}"
    return wanted


LONG_ENOUGH = 40.0  # s: twice the time of the loss
KINDS = some("filtered-vega-range", "filtered-wind-servo", "filtered-functions", "measured-stls", "difference-sr3",
             "integral-lasso", "lpv")  # of every formulation, solver and part of the filter one


@needs_compiler
@pytest.mark.parametrize("name", KINDS)
def test_a_flight_gives_the_same_bits(name, tmp_path):
    config = CONFIGS[name]
    samples = flight("vega_like" if "vega" in name else "constant", "ideal" if "measured" in name else "flight",
                     **(ROUGH if "wind" in name else KNOWN if "known" in name else {}),
                     **(MODES if "modes" in name else {}))
    said = assert_same(built(tmp_path, config), config, [sample for sample in samples if sample.t < LONG_ENOUGH])
    assert sum(line[0] == "window" and line[1] == "0" for line in said) >= 3  # or there was nothing to compare
    assert any(line[0] == "level" for line in said) == ("range" in name)
    changed = any(line[0] == "change" for line in said) or int(said[-1][-1]) > 0  # or withdrawn
    assert changed or "wind" in name or not name.startswith("filtered")


@needs_compiler
def test_a_sudden_change_at_no_time_is_the_same(tmp_path):
    """The onset is no number where factors overflow, and so is the nominal there."""
    model = dataclasses.replace(onboard_model(load_nominal("vega_like")), profile_t=(0.0, 50.0),
                                profile_a6=(7538.0, 100.0), profile_k1=(-11275.0, -100.0), theta_dot_std=2.7e-6)
    config = Config(window=1.0, sample_period=0.01, formulation="filtered", model=model)
    program = built(tmp_path, config)
    for seed in range(3):
        assert_same(program, config, hostile(seed))


@needs_compiler
@pytest.mark.parametrize("name", some("filtered-vega-range", "integral-lasso", of=(
    "filtered-vega-range", "filtered-terms", "measured-stls", "integral-lasso")))
def test_hostile_samples_give_the_same_bits_and_no_undefined_behaviour(name, tmp_path):
    config = CONFIGS[name]
    program = built(tmp_path, config, "-O0", "-fsanitize=address,undefined", "-fno-sanitize-recover")

    @settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.too_slow])
    @given(st.integers(0, 2**32))
    def same(seed):
        assert_same(program, config, hostile(seed))

    same()


@needs_compiler
@pytest.mark.parametrize("name", ["filtered-vega-range", "integral-lasso"])
def test_the_port_needs_nothing_but_mathematics_and_memory_is_the_estimator_s(name, tmp_path):
    """No allocation, no file, no print: what the object asks of other libraries."""
    subprocess.run([str(CC), *STRICT, "-O1", "-fno-stack-protector", "-fno-pic", "-fno-pie", "-c", "launchid.c",
                    "-o", "launchid.o"], cwd=written(tmp_path, CONFIGS[name]), check=True)
    listed = subprocess.run(["nm", "launchid.o"], cwd=tmp_path, capture_output=True, text=True, check=True)
    symbols = [line.split()[-2:] for line in listed.stdout.splitlines()]
    assert {symbol.lstrip("_") for kind, symbol in symbols if kind == "U"} <= {
        "memset", "memcpy", "memmove", "memcmp", "sqrt", "fmod", "frexp", "ldexp", "copysign", "floor", "llabs"}
    assert len(symbols) > 5 and [symbol for kind, symbol in symbols if kind in "bBdDC"] == []


@needs_compiler
@pytest.mark.parametrize("name", ["filtered-vega-range"])
def test_the_header_says_how_large_an_estimator_is(name, tmp_path):
    written(tmp_path, CONFIGS[name])
    said = re.search(r"(\d+) bytes that\s+persist, (\d+) of scratch", (tmp_path / "launchid.h").read_text("utf-8"))
    (tmp_path / "size.c").write_text(
        '#include "launchid.h"\n#include <stdio.h>\n'
        'int main(void) { printf("%zu %zu", sizeof(launchid_state), sizeof(launchid_work)); return 0; }\n')
    subprocess.run([str(CC), *STRICT, "size.c", "-o", "size"], cwd=tmp_path, check=True)
    sizes = subprocess.run(["./size"], cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    assert said is not None and list(said.groups()) == sizes.split()


# ---- the command


@needs_compiler
def test_the_command_writes_a_port_that_compiles(tmp_path, capsys):
    out = tmp_path / "deep" / "port"
    assert main(["export-c", "constant", "--out", str(out), "--window", "5"]) == 0
    assert sorted(path.name for path in out.iterdir()) == sorted(FILES)
    said = capsys.readouterr()
    assert said.out == "" and said.err.count("\n") == 1 and "-ffp-contract=off" in said.err
    subprocess.run([str(CC), *STRICT, "replay.c", "launchid.c", "-lm", "-o", "replay"], cwd=out, check=True)
    config = filtered(ranged=True, window=5.0)  # the nominal has a range
    assert_same(out / "replay", config, flight()[:1500])


@pytest.mark.parametrize(("words", "status", "said"), [
    (["export-c", "constant"], 2, "--out"),
    (["export-c", "constant", "--out", "x", "--window", "-1"], 2, "window"),
    (["export-c", "constant", "--out", "x", "--library", "nonsense"], 2, "nonsense"),
    (["export-c", "nothere.toml", "--out", "x"], 3, "nothere.toml"),
    (["export-c", "pendulum_linear", "--out", "x"], 3, "filtered|requires|section|\\[")])
def test_wrong_words_are_one_line(words, status, said, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(words) == status
    error = capsys.readouterr().err
    assert re.search(said, error) and error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


# ---- what Python has and C has not


class Strict(np.ndarray):
    """An array that refuses an index from the end, which C would take as one before the begin."""

    def _check(self, at):
        for each in at if isinstance(at, tuple) else (at,):
            if isinstance(each, slice):
                good = not each.stop or 0 <= (each.start or 0) <= each.stop <= self.size
            else:
                good = each >= 0
            if not good:
                raise IndexError(f"[{at}] counts from the end")

    def __getitem__(self, at):
        self._check(at)
        return super().__getitem__(at)

    def __setitem__(self, at, value):
        self._check(at)
        super().__setitem__(at, value)


def strict(value):
    """Arrays of a nest of named tuples, made strict."""
    if isinstance(value, np.ndarray):
        return value.view(Strict)
    return type(value)(*map(strict, value)) if hasattr(value, "_fields") else value


@pytest.mark.skipif(not numba.config.DISABLE_JIT, reason="only with NUMBA_DISABLE_JIT=1: compiled code does not ask")
@pytest.mark.parametrize("name", KINDS)
def test_no_kernel_counts_an_index_from_the_end(name):
    """Compiled code may count it from the end, C takes it as it is: each one is asked here."""
    e = Estimator(dataclasses.replace(CONFIGS[name], window=0.4))
    memory = e._memory._replace(parts=strict(e._memory.parts), words=strict(e._memory.words),
                                apart={name: strict(array) for name, array in e._memory.apart.items()})
    e._step = calls_of(e.config, memory).update
    for sample in [*flight()[1900:2100], *hostile(143, 100)]:
        e.update(sample)
    assert e.counts["WINDOW_COMPLETE"] > 3


# ---- a saved state

SAVED_AT = (0, 1, 107, 130, 149, 150, 151, 233, 299)  # samples; windows of 0.5 s have 50
SAVED = {
    "range": filtered(ranged=True, window=0.5),
    "terms": filtered(library="quadratic", window=0.5),
    "measured-stls": CONFIGS["measured-stls"],
    "lpv": CONFIGS["lpv"],
}


def built_saving(folder, config: Config):
    """The program of port_saved.c for a configuration."""
    program = written(folder, config) / "saved"
    subprocess.run([str(CC), *STRICT, "-O0", "-fsanitize=address,undefined", "-fno-sanitize-recover", "-I.",
                    str(SHARED / "port_saved.c"), "launchid.c", "-lm", "-o", str(program)], cwd=folder, check=True)
    return program


def python_saved(config: Config, samples: list[Sample]) -> list[bytes]:
    estimator, found = Estimator(config), []
    for number, sample in enumerate(samples):
        if number in SAVED_AT:
            found.append(estimator.save())
        estimator.update(sample)
    return found


@needs_compiler
@pytest.mark.parametrize("name", some("range", "lpv", of=SAVED))
def test_c_saves_the_bytes_of_python_and_goes_on_from_them(name, tmp_path):
    config, samples = SAVED[name], flight("constant", "ideal" if "measured" in name else "flight")[1950:2260]
    program = built_saving(tmp_path, config)
    words = [word for number in SAVED_AT for word in (str(tmp_path / f"{number}.state"), str(number))]
    done = subprocess.run([str(program), *words], input=as_text(samples), capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == (f"{len(SAVED_AT)} restored\n", "")
    for number, state in zip(SAVED_AT, python_saved(config, samples), strict=True):
        assert (tmp_path / f"{number}.state").read_bytes() == state, f"saved at sample {number}"
    Estimator(config).restore((tmp_path / "151.state").read_bytes())


@needs_compiler
def test_a_state_of_another_configuration_is_foreign(tmp_path):
    config, other = SAVED["range"], Estimator(filtered(ranged=True, window=0.5, noise="declared"))
    state = other.save()
    version = bytearray(state)
    version[12] ^= 1
    version[-4:] = zlib.crc32(version[:-4]).to_bytes(4, "little")
    (written(tmp_path, config) / "foreign.c").write_text("""
#include "launchid.h"
#include <stdio.h>
static launchid_estimator e;
static uint8_t saved[LAUNCHID_SAVED_BYTES];
int main(void)
{
    launchid_reset(&e);
    const size_t n = fread(saved, 1, sizeof saved, stdin);
    printf("%d", (int)launchid_restore(&e, saved, n));
    return 0;
}
""", encoding="utf-8")
    subprocess.run([str(CC), *STRICT, "foreign.c", "launchid.c", "-lm", "-o", "foreign"], cwd=tmp_path, check=True)
    for saved in (state, bytes(version)):
        done = subprocess.run([str(tmp_path / "foreign")], input=saved, capture_output=True, check=True)
        assert done.stdout == b"2"


@needs_compiler
def test_the_notch_of_the_howto_is_the_simulators(tmp_path):
    """As written there it compiles with the port of cr826_max_q, stands at the declared frequency before the first
    estimate, and is tuned as the simulator's."""
    page = (Path(__file__).parents[3] / "docs/howto.md").read_text(encoding="utf-8")
    (code,) = (block for block in re.findall(r"```c\n(.*?)```", page, re.S) if "launchid_get_estimate" in block)
    main = """
int main(void)
{
    static launchid_estimator e;
    launchid_reset(&e);
    follow(&e);
    printf("%.17g %.17g %.17g %.17g %.17g\\n", b0, b1, b2, a1, a2);
    tune(17.3);
    printf("%.17g %.17g %.17g %.17g %.17g\\n", b0, b1, b2, a1, a2);
    return 0;
}
"""
    written(tmp_path, CONFIGS["filtered-still"])
    (tmp_path / "own.c").write_text('#include <math.h>\n#include <stdio.h>\n#include "launchid.h"\n' + code + main)
    subprocess.run([str(CC), *"-std=c99 -Wall -Wextra -Werror -O0 own.c launchid.c -lm -o own".split()], cwd=tmp_path,
                   check=True)
    said = subprocess.run(["./own"], cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    for line, frequency in zip(said.splitlines(), (18.9, 17.3), strict=True):
        section = notch(0.01, frequency, 0.01, 0.4)
        assert np.allclose([float(x) for x in line.split()], [*section.b, *section.a[1:]], rtol=1e-14)
