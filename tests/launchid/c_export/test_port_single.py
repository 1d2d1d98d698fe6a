"""The export in single precision: close to the double one where allowed, refused elsewhere, foreign to its states."""

import subprocess

import pytest
from ported import CC, STRICT, as_text, filtered, flight, needs_compiler, regression, translated

from benchmarks.port_single import compared
from launchid.c_export.single import ERROR, NUMBER, refuse, single_files
from launchid.cli.main import main
from sim.errors import InputError

INTEGRAL = regression("integral", library="theta,beta")


@needs_compiler
@pytest.mark.parametrize("formulation", ["difference", pytest.param("integral", marks=pytest.mark.campaign)])
def test_its_error_is_small_beside_the_standard_deviation(formulation):
    total, differ, largest = compared(regression(formulation, library="theta,beta"), [as_text(flight()[:3000])])
    assert total >= 29 and differ == 0 and 0.0 < largest < ERROR


@needs_compiler
def test_no_compiler_warns_and_no_double_is_left(tmp_path):
    files = single_files(INTEGRAL)
    for name, text in files.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    subprocess.run([str(CC), *STRICT, "-O2", "-c", "launchid.c"], cwd=tmp_path, check=True)
    assert "double" not in files["launchid.h"].split("typedef struct", 1)[1]
    assert all(text.endswith("F") for line in files["launchid.c"].splitlines() if not line.lstrip().startswith("/*")
               for text in (line[m.start():m.end() + 1] for m in NUMBER.finditer(line)))


def test_a_saved_state_of_the_double_one_is_foreign():
    one, other = (files["launchid.c"].split("preface[] = {")[1].split("}")[0]
                  for files in (translated(INTEGRAL), single_files(INTEGRAL)))
    assert one != other and len(one.split(",")) == len(other.split(","))


@pytest.mark.parametrize(("config", "why"), [
    (filtered(), "formulation filtered: what it carries"), (regression("integral"), "library 1, theta"),
    (regression("integral", library="theta,beta", window=0.1), "window 0.1 s")])
def test_what_fails_is_refused_in_one_line(config, why):
    with pytest.raises(InputError, match=f"--float32: {why}") as told:
        refuse(config)
    assert "\n" not in str(told.value)


def test_the_command_refuses_with_status_3_and_writes_what_is_allowed(tmp_path, capsys):
    out = tmp_path / "port"
    assert main(["export-c", "constant", "--out", str(out), "--float32"]) == 3
    assert "--float32: formulation filtered" in capsys.readouterr().err and not out.exists()
    assert main(["export-c", "constant", "--out", str(out), "--float32", "--formulation", "integral"]) == 0
    assert {path.name for path in out.iterdir()} == {"launchid.c", "launchid.h", "replay.c", "README.md"}
    assert "Not the bits of Python" in (out / "README.md").read_text(encoding="utf-8")
