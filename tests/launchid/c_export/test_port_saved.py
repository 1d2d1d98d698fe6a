"""A state that C saves: the bytes of Python's, restored by either, and nothing else is taken for one."""

import subprocess
import zlib

import pytest
from ported import CC, CONFIGS, SHARED, STRICT, as_text, filtered, flight, needs_compiler, some, written

from launchid_core import Config, Estimator, Sample

SAVED_AT = (0, 1, 107, 130, 149, 150, 151, 233, 299)  # samples; windows of 0.5 s have 50
CHOSEN = {
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
@pytest.mark.parametrize("name", some("range", "lpv", of=CHOSEN))
def test_c_saves_the_bytes_of_python_and_goes_on_from_them(name, tmp_path):
    config, samples = CHOSEN[name], flight("constant", "ideal" if "measured" in name else "flight")[1950:2260]
    program = built_saving(tmp_path, config)
    words = [word for number in SAVED_AT for word in (str(tmp_path / f"{number}.state"), str(number))]
    done = subprocess.run([str(program), *words], input=as_text(samples), capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == (f"{len(SAVED_AT)} restored\n", "")
    for number, state in zip(SAVED_AT, python_saved(config, samples), strict=True):
        assert (tmp_path / f"{number}.state").read_bytes() == state, f"saved at sample {number}"
    Estimator(config).restore((tmp_path / "151.state").read_bytes())


@needs_compiler
def test_a_state_of_another_configuration_is_foreign(tmp_path):
    config, other = CHOSEN["range"], Estimator(filtered(ranged=True, window=0.5, noise="declared"))
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
