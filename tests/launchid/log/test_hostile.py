"""The front door as a hostile user finds it: what was seen once, and the test that keeps each from coming back.

What has its test elsewhere is listed by it; what has none is tested here.
"""

import ast
import dataclasses
import math
import os
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from every import every
from ported import as_text, built, filtered, flight, needs_compiler

import launchid
import launchid_core
from launchid.cli.main import main
from launchid.diagnosis.data.used import MOST
from launchid.log.log import write_columns
from sim.nominal import Nominal, load_nominal, write_nominal

ROOT = Path(__file__).resolve().parents[3]
ELSEWHERE = {  # what was seen: file and name of its test, after `test_`
    "a device is replaced": "files a_device_stays_a_device",
    "a FIFO is replaced": "files a_fifo_is_written_through",
    "a symlink is replaced": "files behind_a_link_the_target_is_replaced_and_the_link_stays",
    "a read-only file is overwritten": "files a_read_only_file_is_refused_even_to_root",
    "a file's mode changes": "files the_mode_of_a_file_stays",
    "a command overwrites its input": "files the_input_is_no_output",
    "temporary files stay after kill -9":
        "files what_a_killed_run_left_goes_at_the_next_and_a_living_one_s_stays",
    "a FIFO is no log": "files a_log_is_read_from_a_fifo",
    "- and <(...) are no log": "files a_log_is_read_from_a_process_s_output_and_from_standard_input",
    "a sign is taken without a word": "checked one_line_of_warning_and_exit_3_with_strict",
    "fit-lft takes a reversed sign": "checked fit_lft_refuses_a_foreign_column_and_fits_what_lost_a_stamp",
    "times in ms are a window's fault": "checked times_in_milliseconds_without_a_nominal_are_recognised",
    "a short profile is held silently": "checked a_profile_that_ends_before_the_flight_is_one_line",
    "--plot without matplotlib": "start without_matplotlib_one_line_says_what_to_install",
    "a full disk on stdout": "start a_full_disk_behind_stdout_is_one_line",
    "Ctrl-C while importing": "start an_interrupt_while_modules_are_imported_is_one_line",
    "--tracked prints no tracked estimate": "launchid identify_prints_the_tracked_columns_when_asked",
    "two rows are an empty table": "launchid a_log_of_two_rows_gives_a_sentence",
    "--help says little": "reference every_option_has_text_unit_and_default",
    "update(None) leaks internals": "pictures what_is_no_sample_is_refused_in_plain_words",
    "the first window crushes the picture":
        "pictures what_is_not_determined_does_not_set_the_scale_and_is_marked_at_the_edge",
    "legends over data": "pictures legends_lie_outside_the_data",
    "4.5253 +- 1.6": "launchid a_value_is_shown_to_two_digits_of_its_standard_deviation",
    "a first delta of 7.7": "pictures a_first_delta_of_7_7_does_not_crush_the_bands",
    "eighteen decades": "pictures errors_at_rounding_leave_a_readable_range_and_are_counted",
    "the wheel installs sim alone": "launchid the_package_is_typed_and_installed"}


@every("seen", ELSEWHERE)
def test_what_was_seen_has_its_test(seen):
    file, name = ELSEWHERE[seen].split()
    path, = (ROOT / "tests").rglob(f"test_{file}.py")
    tree = ast.parse(path.read_text(encoding="utf-8"))
    assert f"test_{name}" in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def run(capsys, *words: object) -> tuple[int, str, str]:
    capsys.readouterr()
    status = main([str(word) for word in words])
    return status, *capsys.readouterr()


@pytest.fixture(scope="module")
def nominal() -> Nominal:
    """The constant nominal, of 20 s."""
    found = load_nominal("constant")
    assert found.simulation is not None
    return dataclasses.replace(found, simulation=dataclasses.replace(found.simulation, duration=20.0))


@pytest.fixture(scope="module")
def folder(tmp_path_factory, nominal) -> Path:
    """A flight in degrees, as an engineer's logger may write it, and its nominal."""
    path = tmp_path_factory.mktemp("hostile")
    write_nominal(nominal, path / "n.toml")
    columns = launchid.simulate(nominal, seed=3).log.measured()
    write_columns(path / "degrees.csv", {name: x if name == "t" else np.degrees(x) for name, x in columns.items()})
    return path


# ---- what is not what it seems


@pytest.mark.parametrize("words", ["identify LOG --nominal N --window 5", "identify LOG --window 5",
                                   "uncertainty LOG N --window 5"])
def test_degrees_are_warned_of_and_refused_with_strict(folder, capsys, words):
    """Degrees of every column cannot be seen without a nominal: then only the nominal could tell."""
    given = words.replace("LOG", str(folder / "degrees.csv")).replace(" N", f" {folder / 'n.toml'}").split()
    status, out, err = run(capsys, *given)
    assert status == 0 and out
    if "N" in words:
        assert "degrees" in err and len(err.splitlines()) == 1
        status, out, err = run(capsys, *given, "--strict")
        assert (status, out) == (3, "") and "degrees" in err and len(err.splitlines()) == 1


def test_fit_lft_refuses_degrees(folder, capsys):
    """The command wrote a range of 9.5."""
    status, out, err = run(capsys, "fit-lft", folder / "degrees.csv", folder / "n.toml", "--out", folder / "new.toml")
    assert (status, out) == (3, "") and "degrees" in err and len(err.splitlines()) == 1
    assert not (folder / "new.toml").exists()


@needs_compiler
def test_replay_refuses_a_csv_in_one_line(folder, tmp_path):
    """`./replay < log.csv` printed nothing: other order, commas, a header."""
    program = built(tmp_path, filtered(window=5.0))
    rows = as_text(flight()[:20])
    for text, sample in ((folder / "degrees.csv").read_text(), 1), (rows.replace(" ", ","), 1), (rows + "1 2 3\n", 21):
        done = subprocess.run([str(program)], input=text, capture_output=True, text=True, timeout=60, check=False)
        assert done.returncode == 1 and len(done.stderr.splitlines()) == 1
        assert f"sample {sample}: expected seven numbers with blanks between, t theta theta_dot beta" in done.stderr
    done = subprocess.run([str(program)], input=rows, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "") and len(done.stdout.splitlines()) == 21


def test_the_version_is_said(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    assert ended.value.code == 0
    assert capsys.readouterr().out == f"launchid {launchid.__version__}\n"
    assert launchid.__version__ == launchid_core.__version__


# ---- the terminal


@pytest.mark.skipif(not os.path.exists("/dev/fd") or os.name != "posix", reason="no pipes by name here")
def test_a_reader_that_has_gone_is_no_traceback(folder):
    """The command is `launchid identify LOG | head -1`."""
    command = subprocess.Popen([sys.executable, "-m", "sim", "effects"], cwd=ROOT, stdout=subprocess.PIPE,
                               stderr=subprocess.PIPE)
    assert command.stdout is not None and command.stderr is not None
    command.stdout.close()
    assert command.stderr.read() == b"" and command.wait(300) in (0, 3)


# ---- a log of the simulator itself, and one of a million rows


@pytest.mark.campaign
def test_the_truth_is_recognised_and_nothing_is_explained_by_it(nominal):
    """The nominal's own noise-free flight was EXPLAINED by a size of 1 +- 1.9e-07, its `ideal` suite UNEXPLAINED."""
    quiet = dataclasses.replace(nominal, sensors=dataclasses.replace(
        nominal.sensors, theta_std=0.0, theta_dot_std=0.0, beta_std=0.0))
    log = launchid.simulate(quiet, seed=3).log.measured()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        own, other = launchid.diagnose(log, quiet), launchid.diagnose(log, nominal)
    assert own.verdict == "consistent", own.summary()
    assert other.report["causes"] == [] and other.extension is None, other.summary()
    with pytest.warns(launchid.DataWarning, match="ideal suite"):
        launchid.diagnose(launchid.simulate(nominal, seed=3, suite="ideal").log.measured(), nominal)


@pytest.mark.campaign
def test_a_million_rows_are_diagnosed_and_it_is_said_which(nominal):
    """A log of that size had no answer, and no warning."""
    assert nominal.simulation is not None
    period, once = 0.001, 1_000_000
    long = dataclasses.replace(nominal, simulation=dataclasses.replace(nominal.simulation, duration=once * period))
    log = launchid.simulate(long, seed=3, period=period).log
    assert len(log.t) == once
    made = launchid.diagnose(log, long)
    used = made.diagnosis.used
    assert used is not None and used.rows <= MOST
    assert math.isclose(used.end - used.begin, used.rows * used.every * period, rel_tol=0.01)
    assert f"  {used.words}" in made.summary().splitlines()
    assert made.verdict == "consistent", made.summary()
