"""Write a command's report: a folder with one page that needs no network, the result's JSON, the figures as PNG."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from sim.errors import InputError
from sim.files import make_folder, remove, write_text

from .page import page, picture, table, text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOUR = "#12355b"
REPORT_FILE = "report.html"
NO_FIGURES = "There are no figures: they need matplotlib (pip install 'launchid[plots]')."
Words = Sequence[tuple[str, str]]


class Picture(NamedTuple):
    """A figure of a report: its heading, how to read it, and the function that draws it (None: nothing to draw)."""

    heading: str
    caption: str
    draw: "Callable[[], Figure | None]"


Section = tuple[str, Sequence[str | Mapping[str, Picture]]]   # title, and its parts: HTML, or file name -> picture


def write_report(folder: str | Path, headline: str, above: str, first: str, sections: Sequence[Section],
                 json: tuple[str, str], *, glossary: Words = (), colour: str = COLOUR,
                 stale: Sequence[str] = ()) -> None:
    """Write a report into a folder, made if there is none; pictures of an earlier report that it lacks are removed.

    Parameters
    ----------
    folder : where to
    headline, above : the title of the page, and the line above it
    first : the first screen, as HTML
    sections : of the page; one without HTML and without a figure is left out
    json : name of the file, and its text
    glossary : words of the page and their meaning, its last section
    colour : of the band behind the title
    stale : names of further files that an earlier report may have left, and this one may lack

    Raises
    ------
    InputError
        If the folder cannot be written.
    """
    path = make_folder(folder)
    try:
        for name in (*stale, *(name for _, parts in sections for part in parts if not isinstance(part, str)
                               for name in part)):
            remove(path / name)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror}); expected a folder to write into") from None
    bodies = [(title, "".join(part if isinstance(part, str) else drawn(part, path) for part in parts))
              for title, parts in sections]
    words = table(("word", "meaning"), [(f"<b>{text(word)}</b>", text(meaning)) for word, meaning in glossary])
    write_text(path / json[0], [json[1], "\n"])
    write_text(path / REPORT_FILE, [page(headline, above, colour, first, [*bodies, ("Words", words)])])


def drawn(pictures: Mapping[str, Picture], folder: Path) -> str:
    """Draw the pictures, write each into the folder under its name, and return their HTML for the page."""
    try:
        from sim.canvas import save

        from .curves import figure_json
        parts = []
        for name, each in pictures.items():
            figure = each.draw()
            if figure is not None:
                live = figure_json(figure)
                save(figure, folder / name)
                parts.append(picture(name.partition(".")[0], each.heading, each.caption, (folder / name).read_bytes(),
                                     live))
    except ModuleNotFoundError as error:
        if not (error.name or "").startswith("matplotlib"):
            raise
        return f"<p>{text(NO_FIGURES)}</p>"
    return "".join(parts)


def paragraphs(lines: Sequence[str]) -> str:
    """Return lines of text as HTML, a paragraph of a page's notes each."""
    return "".join(f'<p class="note">{text(line)}</p>' for line in lines)
