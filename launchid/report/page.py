"""HTML of a report's page: one file that needs no network; a browser with scripts draws the figures as charts."""

import base64
import json
from collections.abc import Iterable, Sequence
from html import escape
from string import Template
from typing import Any

from .inline import FOLDER, inlined


def text(words: object) -> str:
    """Return words as HTML, special characters escaped."""
    return escape(str(words)).replace("+-", "&plusmn;").replace("-&gt;", "&rarr;")


def table(head: Sequence[str], rows: Iterable[Sequence[str]], chosen: Sequence[bool] = ()) -> str:
    """Return an HTML table of a text head and rows of HTML cells, "" without rows; `chosen` rows are set off."""
    marks = ['<tr class="chosen">' if mark else "<tr>" for mark in chosen]
    body = [f"{marks[k] if k < len(marks) else '<tr>'}{''.join(f'<td>{cell}</td>' for cell in row)}</tr>"
            for k, row in enumerate(rows)]
    top = "".join(f"<th>{text(cell)}</th>" for cell in head)
    return f'<div class="wide"><table><thead><tr>{top}</tr></thead><tbody>{"".join(body)}</tbody></table></div>\n' \
        if body else ""


def list_of(items: Sequence[str]) -> str:
    """Return HTML of the items (HTML too): a single one as it is, several as a list."""
    return items[0] if len(items) == 1 else f"<ul>{''.join(f'<li>{item}</li>' for item in items)}</ul>"


TEMPLATE = FOLDER / "page.html"


def page(headline: str, above: str, colour: str, first: str, sections: Sequence[tuple[str, str]]) -> str:
    """Return the whole page as HTML.

    headline, above   title, and the line above it, as text;  colour: of the band behind them
    first             HTML of the first screen;  sections: (title, HTML) each, those without HTML are left out
    """
    parts = [(title, body) for title, body in sections if body]
    links = "".join(f'<a href="#s{k}">{text(title)}</a> ' for k, (title, _) in enumerate(parts))
    body = "".join(f'<section id="s{k}"><h2>{text(title)}</h2>{body}</section>'
                   for k, (title, body) in enumerate(parts))
    return inlined(Template(TEMPLATE.read_text(encoding="utf-8")).substitute(
        headline=text(headline), above=text(above), colour=colour, first=first, links=links, sections=body))


def picture(name: str, title: str, caption: str, png: bytes, live: dict[str, Any] | None) -> str:
    """Return HTML of a figure: its PNG and, in browsers with scripts, the chart of `live` (`figure_json`; None: none)
    in its place; `name` is the chart's id on the page."""
    chart = "" if live is None else (
        f'<div class="chart" id="{name}"><script type="application/json">'
        + json.dumps(live, separators=(",", ":"), allow_nan=False).replace("</", "<\\/") + "</script></div>")
    return (f'<figure><h3>{text(title)}</h3><img alt="{text(title)}" src="data:image/png;base64,'
            f"{base64.b64encode(png).decode('ascii')}\">{chart}<figcaption>{text(caption)}</figcaption></figure>\n")
