"""`launchid show`: logs drawn over each other, with what the data check finds; and `compare` as a command."""

import json
import re

import numpy as np
import pytest

from launchid.cli.main import main
from launchid.figures.logs import logs_figure, looked_at
from launchid.log.log import log_of, write_columns

pytest.importorskip("matplotlib", reason="matplotlib is not installed: no figures")

T = 0.01 * np.arange(2000)


def columns(scale: float = 1.0) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(1)
    theta = 0.1 * scale * np.sin(T)
    return {"t": T, "theta": theta + 1e-4 * rng.standard_normal(len(T)),
            "theta_dot": 0.1 * scale * np.cos(T) + 1e-4 * rng.standard_normal(len(T)),
            "beta": 0.02 * scale * np.sin(T + 1.0) + 1e-4 * rng.standard_normal(len(T))}


def crosses(axis) -> list[np.ndarray]:
    return [line.get_xdata() for line in axis.lines if line.get_marker() == "x"]


def test_each_log_has_a_line_in_each_panel_and_its_name_once():
    logs = [log_of(columns(k), f"{name}.csv") for k, name in ((1.0, "one"), (2.0, "two"))]
    figure = logs_figure([looked_at(log) for log in logs])
    assert [axis.get_ylabel() for axis in figure.axes] == ["theta [rad]", "beta [rad]", "theta_dot [rad/s]"]
    for axis in figure.axes:
        assert [text.get_text() for text in axis.get_legend().get_texts()] == ["one", "two"]
        assert len({(line.get_color(), line.get_linestyle()) for line in axis.lines}) == 2
        assert not crosses(axis)


def test_a_column_in_another_unit_is_grey_and_named():
    given = columns()
    degrees = looked_at(log_of(given | {"theta_dot": np.degrees(given["theta_dot"])}))
    assert [fault.kind for fault in degrees.faults] == ["unit"]
    titles = {axis.get_ylabel(): axis.get_title(loc="right") for axis in logs_figure([degrees]).axes}
    assert titles == {"theta [rad]": "", "beta [rad]": "", "theta_dot [rad/s]": "hatched: unit?"}


@pytest.mark.parametrize(("name", "start"), [("look.png", b"\x89PNG"), ("look.svg", b"<?xml"),
                                             ("look.html", b"<!DOCTYPE")])
def test_pictures_and_a_page(name, start, tmp_path, capsys):
    write_columns(tmp_path / "a.csv", columns())
    write_columns(tmp_path / "b.csv", columns(2.0))
    out = tmp_path / name
    assert main(["show", str(tmp_path / "a.csv"), str(tmp_path / "b.csv"), "--out", str(out)]) == 0
    assert out.read_bytes().startswith(start)
    said = capsys.readouterr().out
    assert said.count("2000 rows") == 2 and said.endswith("drawn\n")
    if name.endswith("html"):
        page = out.read_text(encoding="utf-8")
        chart = json.loads(re.search(r'<script type="application/json">(.*?)</script>', page)[1])
        assert [panel["series"][0]["label"] for panel in chart["panels"]] == ["a"] * 3
        assert "The data check finds nothing" in page


def test_a_suffix_that_is_no_picture_and_a_log_that_is_not_there(tmp_path):
    write_columns(tmp_path / "a.csv", columns())
    assert main(["show", str(tmp_path / "a.csv"), "--out", str(tmp_path / "look.txt")]) == 2
    assert main(["show", str(tmp_path / "none.csv")]) == 3


# ---- compare, as a command


def test_compare_prints_its_json_alone(tmp_path, capsys):
    assert main(["simulate", "constant", "--out", str(tmp_path / "a.csv"), "--seed", "3"]) == 0
    capsys.readouterr()
    assert main(["compare", str(tmp_path / "a.csv"), "constant", "--flights", "4", "--json", "-"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["nominals"][0]["nominal"] == "constant"
    assert said["nominals"][0]["channels"]["theta"]["percentile"]["peak"] in (0.0, 0.25, 0.5, 0.75, 1.0)
    assert main(["compare", str(tmp_path / "a.csv"), "constant", "--flights", "-1"]) == 2
    assert main(["compare", str(tmp_path / "a.csv"), "no_such_nominal"]) == 3
