"""Curves on a page: what of a figure is drawn again by the browser, and that a page holds all it needs."""

import re

import numpy as np
import pytest

pytest.importorskip("matplotlib", reason="matplotlib is not installed: no figures")

from matplotlib.figure import Figure

from launchid.charts import FOLDER, MARKS, inlined
from launchid.charts.figure import figure_json


def curves(rows: int = 1, columns: int = 1):
    figure = Figure(figsize=(9.0, 2.0 * rows))
    return figure, figure.subplots(rows, columns, sharex=True, squeeze=False)


@pytest.mark.parametrize("origin", [0.0, 1.7e9])
def test_every_number_of_a_curve_is_there(origin):
    """Times are there to a microsecond, also of stamps since 1970, and values to five digits; an unknown one is a
    gap."""
    figure, axes = curves(2)
    t, x = origin + 0.01 * np.arange(500), np.random.default_rng(1).normal(size=500)
    x[17] = np.nan
    axes[0, 0].plot(t, x, label="x")
    axes[1, 0].plot(t, 2.0 * x, "o", label="y")
    found = figure_json(figure)
    first, second = (panel["series"][0] for panel in found["panels"])
    assert np.allclose(found["arrays"][first["x"]], t, rtol=0.0, atol=1e-2 if origin else 1e-9)
    drawn = np.array(found["arrays"][first["y"]], dtype=float)
    assert np.array_equal(np.isnan(drawn), np.isnan(x)) and np.allclose(drawn, x, rtol=1e-4, equal_nan=True)
    assert first["x"] == second["x"] and len(found["arrays"]) == 3, "an abscissa is there once"
    assert (first["width"] > 0, first["size"], second["width"], second["size"] > 0) == (True, 0, 0, True)
    assert {panel["group"] for panel in found["panels"]} == {0}, "one abscissa, one zoom"


@pytest.mark.parametrize("draw", [
    lambda axis: axis.bar([1.0], [2.0]), lambda axis: axis.errorbar([1.0], [2.0], [0.1]),
    lambda axis: axis.imshow(np.eye(3)), lambda axis: axis.fill_between([0.0, 1.0], 0.0, 1.0)])
def test_what_is_no_curve_stays_a_picture(draw):
    figure, ((axis,),) = curves()
    draw(axis)
    assert figure_json(figure) is None
    assert figure_json(Figure()) is None


def test_a_page_holds_the_library_its_licence_and_nothing_from_elsewhere():
    page = inlined("<style>/* charts.css */</style><script>/* charts.js */</script><p>/* charts.js */</p>")
    for names in MARKS.values():
        for name in names:
            assert (FOLDER / name).read_text(encoding="utf-8") in page
    assert "MIT License" in page and "Copyright (c) 2022 Leon Sorokin" in page
    assert page.endswith("<p>/* charts.js */</p>"), "what a user wrote stands for itself"
    assert page.count("</script") == page.count("</style") == 1, "nothing in them ends them early"
    assert set(re.findall(r"https?://[^\s\"')]+", page)) == {"https://github.com/leeoniya/uPlot"}, "who made it"
    assert not re.search(r"fetch\(|XMLHttpRequest|import\(|@import|url\(|WebSocket", page)
