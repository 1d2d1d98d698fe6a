"""`--help`: an example that parses, and the page made of the parser; completion; the catalogue of effects as JSON."""

import argparse
import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from every import every

from launchid.cli.reference import commands_page, effects_report
from launchid.main import main, parser
from sim.effects import CATALOGUE

ROOT = Path(__file__).resolve().parents[3]


def commands() -> dict[str, argparse.ArgumentParser]:
    (action,) = [action for action in parser()._actions if isinstance(action, argparse._SubParsersAction)]
    return dict(action.choices)


@every("name", commands())
def test_every_command_has_an_example_that_parses(name, capsys):
    example = re.fullmatch(r"example: launchid (.+)", commands()[name].epilog or "")
    assert example is not None, "one, as the last line of its help"
    assert parser().parse_args(shlex.split(example[1])).command == name
    with pytest.raises(SystemExit):
        main([name, "--help"])
    assert " ".join(capsys.readouterr().out.split()).endswith(example[0])


def test_the_page_of_commands_is_the_parser_s():
    page = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    assert page == commands_page(parser()), "write it anew, as launchid/cli/reference.py says"


# ---- completion


@pytest.mark.parametrize(("line", "wanted"), [
    ("launchid unc", {"uncertainty"}), ("launchid identify --sol", {"--solver"}),
    ("launchid identify v.csv --solver ", {"stls", "sr3", "ssr", "lasso"})])
def test_the_shell_is_told_what_could_come_next(line, wanted, tmp_path):
    pytest.importorskip("argcomplete")
    asked = {"_ARGCOMPLETE": "1", "COMP_LINE": line, "COMP_POINT": str(len(line)), "_ARGCOMPLETE_IFS": "\n",
             "_ARGCOMPLETE_STDOUT_FILENAME": str(tmp_path / "told")}
    subprocess.run([sys.executable, "-m", "sim"], cwd=ROOT, env=os.environ | asked, check=True, timeout=60)
    assert {word.strip() for word in (tmp_path / "told").read_text().splitlines()} == wanted


# ---- effects


def test_effects_as_json(capsys, tmp_path):
    assert main(["effects", "--json", "-"]) == 0
    listed = json.loads(capsys.readouterr().out, parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))
    assert listed == effects_report()
    assert main(["effects", "--json", str(tmp_path / "x.json")]) == 0
    assert json.loads((tmp_path / "x.json").read_text()) == listed
    rows = {row["effect"]: row for row in listed["effects"]}
    assert list(rows) == list(CATALOGUE)
    assert rows["control_loss"]["diagnosed"] and rows["control_loss"]["where"] == "plant"
    time = rows["control_loss"]["parameters"][1]
    assert (time["name"], time["unit"], time["required"], time["default"]) == ("time", "s", True, None)
    slosh = rows["slosh"]["parameters"]
    assert [p["default"] for p in slosh] == [0.0, None, 0.02] and slosh[0]["low"] == -0.9
