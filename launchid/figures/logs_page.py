"""Logs as a page that zooms."""

import io
from collections.abc import Sequence

from matplotlib.figure import Figure

from sim.canvas import DPI
from sim.files import write_text

from ..charts.figure import figure_json
from ..charts.markup import list_of, text
from ..charts.page import page, picture
from .logs import Looked

COLOUR = "#12355b"
CAPTION = "Each log has its colour and dash. Crosses: values that the data check doubts; grey: columns that it doubts."


def write_page(logs: Sequence[Looked], figure: Figure, path: str) -> None:
    """Write the figure of logs as one page that needs no network."""
    png = io.BytesIO()
    figure.savefig(png, dpi=DPI, bbox_inches="tight", format="png", metadata={"Software": None})
    said = [text(line) for each in logs for line in each.lines]
    first = "".join(f"<p>{text(each.log.summary())}</p>" for each in logs) \
        + (f"<p>{list_of(said)}</p>" if said else "<p>The data check finds nothing.</p>")
    write_text(path, [page(str(figure.get_suptitle()), "launchid show: logs as they are", COLOUR, first, [
        ("Figures", picture("columns", "Columns over time", CAPTION, png.getvalue(), figure_json(figure)))])])
