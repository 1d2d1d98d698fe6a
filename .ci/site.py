"""Hooks of mkdocs: pages and files that lie beside `docs` become part of the site.

README.md is its first page, CHANGELOG.md its list of changes; what a page links to outside `docs` (figures, sources,
the licence) is brought to `files/` of the site.  The pages themselves stay as they are read on a code host.
"""

import posixpath
import re
from pathlib import Path

from mkdocs.structure.files import File

ROOT = Path(__file__).resolve().parents[1]
PAGES = {"README.md": "index.md", "CHANGELOG.md": "changelog.md"}   # file of the project -> page of the site
LINK = re.compile(r"(\]\()([^)\s#]+)(#[^)\s]*)?\)")


def place_of(page):
    """The folder of the project that the links of a page of the site begin from."""
    return "" if page in PAGES.values() else posixpath.dirname(posixpath.join("docs", page))


def on_files(files, config):
    """Add the pages and files beside `docs`."""
    for source, page in PAGES.items():
        files.append(File.generated(config, page, content=(ROOT / source).read_text(encoding="utf-8")))
    linked = set()
    for file in files.documentation_pages():
        for _, target, _ in LINK.findall(file.content_string):
            path = posixpath.normpath(posixpath.join(place_of(file.src_uri), target))
            if "://" not in target and not path.startswith("docs/") and path not in PAGES and (ROOT / path).is_file():
                linked.add(path)
    for path in sorted(linked):
        name = f"files/{path}" if path.endswith(".png") else f"files/{path}.txt"  # text, not another page
        files.append(File.generated(config, name, content=(ROOT / path).read_bytes()))
    return files


def on_page_markdown(markdown, page, config, files):
    """Let links that leave `docs` lead to where `on_files` brought their targets."""
    def led(match):
        opening, target, anchor = match.groups()
        if "://" in target or target.startswith("#"):
            return match.group()
        path = posixpath.normpath(posixpath.join(place_of(page.file.src_uri), target))
        if path in PAGES:
            path = PAGES[path]
        elif path.startswith("docs/"):
            path = path.removeprefix("docs/")
        else:
            path = f"files/{path}" if path.endswith(".png") else f"files/{path}.txt"
        return f"{opening}{posixpath.relpath(path, posixpath.dirname(page.file.src_uri) or '.')}{anchor or ''})"
    return LINK.sub(led, markdown)
