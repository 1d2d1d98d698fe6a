"""Words, tables and lists as HTML."""

from collections.abc import Iterable, Sequence
from html import escape


def text(words: object) -> str:
    """Words as HTML."""
    return escape(str(words)).replace("+-", "&plusmn;").replace("-&gt;", "&rarr;")


def table(head: Sequence[str], rows: Iterable[Sequence[str]], chosen: Sequence[bool] = ()) -> str:
    """A table of cells that are HTML already; '' without rows. `chosen` rows are set off."""
    marks = ['<tr class="chosen">' if mark else "<tr>" for mark in chosen]
    body = [f"{marks[k] if k < len(marks) else '<tr>'}{''.join(f'<td>{cell}</td>' for cell in row)}</tr>"
            for k, row in enumerate(rows)]
    top = "".join(f"<th>{text(cell)}</th>" for cell in head)
    return f"<table><thead><tr>{top}</tr></thead><tbody>{''.join(body)}</tbody></table>\n" if body else ""


def list_of(items: Sequence[str]) -> str:
    """One as it is, more as a list; HTML in and out."""
    return items[0] if len(items) == 1 else f"<ul>{''.join(f'<li>{item}</li>' for item in items)}</ul>"
