"""The page of a report: one file that needs no network; where the browser runs scripts it draws the figures again."""

import base64
import json
from collections.abc import Sequence
from pathlib import Path
from string import Template
from typing import Any

from . import inlined
from .markup import text

TEMPLATE = Path(__file__).with_name("page.html")


def page(headline: str, above: str, colour: str, first: str, sections: Sequence[tuple[str, str]]) -> str:
    """Return the whole page.

    headline, above   the title, and the words above it;  colour  of their band
    first             the first screen, as HTML;  sections  (title, HTML), those without any are left out
    """
    parts = [(title, body) for title, body in sections if body]
    links = "".join(f'<a href="#s{k}">{text(title)}</a> ' for k, (title, _) in enumerate(parts))
    body = "".join(f'<section id="s{k}"><h2>{text(title)}</h2>{body}</section>'
                   for k, (title, body) in enumerate(parts))
    return inlined(Template(TEMPLATE.read_text(encoding="utf-8")).substitute(
        headline=text(headline), above=text(above), colour=colour, first=first, links=links, sections=body))


def picture(name: str, title: str, caption: str, png: bytes, live: dict[str, Any] | None) -> str:
    """Return a figure of the page: its PNG, and what a browser with scripts draws in the place of that (`figure_json`);
    `name` is its own on the page."""
    chart = "" if live is None else (
        f'<div class="chart" id="{name}"><script type="application/json">'
        + json.dumps(live, separators=(",", ":"), allow_nan=False).replace("</", "<\\/") + "</script></div>")
    return (f'<figure><h3>{text(title)}</h3><img alt="{text(title)}" src="data:image/png;base64,'
            f"{base64.b64encode(png).decode('ascii')}\">{chart}<figcaption>{text(caption)}</figcaption></figure>\n")
