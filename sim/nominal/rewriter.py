"""Write a changed nominal into the text of its file: lines that hold the same values stay as they are, to the byte.

The text is cut into statements by the parser itself: one is the fewest lines that parse, a comment, a blank line, a
header, or a key with its value.  The edited text is read back and compared; a file that cannot be edited is written
anew, and says so.
"""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from ..errors import InputError
from ..files import write_text
from ..sections import Nominal
from .reader import parsed, text_of
from .writer import Content, content_of, is_section, key_of, lines_of, literal

ANEW = "# written anew: the comments of the file that it came from could not be kept"
LINE = re.compile(r"[^\n]*\n|[^\n]+")   # with its end
KEY_PART = re.compile(r"[^=]*=\s*")     # a key up to its value
QUOTES = ('"', "'")

Place = tuple[str, ...]


class Statement(NamedTuple):
    """Lines of TOML that parse together, and the keys down to them (`place`): () of a comment; of a header, and of a
    key with an inline section as value, those of the section."""

    text: str
    place: Place
    is_header: bool
    is_inline: bool   # a key with sections as its value


def rewrite_nominal(nominal: Nominal, path: str | Path) -> None:
    """Write a nominal that reads back equal, with the comments and the order of the file that it came from, if any."""
    path = Path(path)
    content = content_of(nominal, path)
    write_text(path, (line + "\n" for line in lines_of(content)) if not nominal.path else
               [_rewritten(Path(nominal.path), path, content)])


def _rewritten(source: Path, path: Path, content: Content) -> str:
    anew = "\n".join(lines_of(content)) + "\n"
    try:
        text = text_of(source)
        before = content_of(parsed(source, text), source)
    except InputError:  # it is no longer there, or another one
        return f"{ANEW}\n{anew}"
    before["name"] = tomllib.loads(text).get("name", path.stem)   # a file without a name has its own
    new = edited(text, before, content)
    try:
        return new if content_of(parsed(path, new), path) == content else f"{ANEW}\n{anew}"
    except InputError:
        return f"{ANEW}\n{anew}"


def edited(text: str, before: Content, after: Content) -> str:
    """Return the text of a nominal file with content `before`, edited so that it holds content `after`."""
    old, new = dict(_leaves(before)), dict(_leaves(after))
    changed = {place for place in (*old, *new) if old.get(place) != new.get(place)}
    missing = {place: new[place] for place in new if place in changed}
    kept, last = [""], dict[Place, int]({(): 0})   # what stays, and where in it a section's last key is
    for place in changed:
        if is_section(old.get(place)) and _begins(new.get(place), old[place]):
            changed = changed - {place}
            missing[place] = missing[place][len(old[place]):]
    for each in statements(text):
        now = each.text
        touched = each.is_inline and any(_within(each.place, place) or _within(place, each.place)
                                         for place in (*changed, *missing))
        if touched:
            now, missing = "", missing | {place: new[place] for place in new if _within(place, each.place)}
        elif any(_at(before, each.place[:k]) and not _at(after, each.place[:k]) for k in range(1, len(each.place) + 1)):
            now = ""
        elif each.place in changed and not is_section(new[each.place]):
            now = _with_value(each.text, new[each.place])
            missing.pop(each.place)
        elif any(_within(each.place, place) for place in changed):
            now = ""
        kept.append(now)
        if each.place and now:
            last[each.place if each.is_header else each.place[:-1]] = len(kept) - 1
    empty = [key for key, value in after.items() if value == {} and key not in before]
    return _with_missing(kept, last, missing, empty)


def _with_missing(kept: list[str], last: dict[Place, int], missing: dict[Place, Any], empty: list[str]) -> str:
    """Return the statements with missing keys after the last of their section, new sections at the end."""
    sections: dict[Place, list[str]] = {(key,): [] for key in empty}
    lists: list[str] = []
    for place, value in missing.items():
        if is_section(value):
            lists += lines_of({place[-1]: value}, place[:-1])
        else:
            sections.setdefault(place[:-1], []).append(f"{key_of(place)} = {literal(value)}")
    end = "\r\n" if any(part.endswith("\r\n") for part in kept) else "\n"
    tail: list[str] = []
    for section, lines in sections.items():
        if section in last:
            before = kept[last[section]]
            kept[last[section]] = before + ("" if before.endswith("\n") or not before else end) + \
                "".join(line + end for line in lines)
        else:
            tail += ["", f"[{'.'.join(section)}]", *lines]
    whole = "".join(kept)
    return whole + (end if tail + lists and not whole.endswith("\n") else "") + \
        "".join(line + end for line in (*tail, *lists))


def statements(text: str) -> Iterator[Statement]:
    """Yield the statements of a TOML text in order; joined they are the text, byte for byte."""
    part = ""
    section: Place = ()
    for line in LINE.findall(text):
        part += line
        if part != line and not _may_end(line):
            continue
        try:
            table = tomllib.loads(part)
        except ValueError:
            continue
        is_header = part.lstrip().startswith("[")
        is_table = not is_header and KEY_PART.sub("", part, count=1).startswith("{")
        place, value = _place(table, 1 if is_table else len(part))
        section = place if is_header else section
        yield Statement(part, place if is_header or not place else (*section, *place), is_header,
                        bool(place) and not is_header and is_section(value))
        part = ""


def _may_end(line: str) -> bool:
    """Whether a list or a text of several lines may end here: else no need to parse all of it again."""
    code = line.partition("#")[0]
    code = line if any(quote in code for quote in QUOTES) else code
    return "]" in code or any(3 * quote in line for quote in QUOTES)


def _place(table: object, deepest: int) -> tuple[Place, object]:
    """Return the keys down to the one value of a statement's table, and the value."""
    place: Place = ()
    while isinstance(table, dict) and len(table) == 1 and len(place) < deepest:
        ((key, value),) = table.items()
        place, table = (*place, key), value[0] if value == [{}] else value
    return place, table


def _leaves(content: Content, place: Place = ()) -> Iterator[tuple[Place, Any]]:
    for key, value in content.items():
        if isinstance(value, dict):
            yield from _leaves(value, (*place, key))
        else:
            yield (*place, key), value


def _at(content: object, place: Place) -> bool:
    """Whether `content` has a section, or sections, at this place."""
    for key in place:
        content = content.get(key) if isinstance(content, dict) else None
    return content is not None


def _begins(now: object, was: Any) -> bool:
    """Whether a list of sections begins with those of `was`."""
    return isinstance(now, list) and now[:len(was)] == was


def _within(place: Place, outer: Place) -> bool:
    return place[:len(outer)] == outer


def _with_value(text: str, value: Any) -> str:
    """Return a key's statement with another value; its comment stays."""
    head = KEY_PART.match(text)
    assert head is not None
    for mark in re.finditer("#", text):
        try:
            tomllib.loads(text[:mark.start()])
        except ValueError:  # it stands in the value
            continue
        return head[0] + literal(value) + text[len(text[:mark.start()].rstrip()):]
    return head[0] + literal(value) + text[len(text.rstrip()):]
