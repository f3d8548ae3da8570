"""Fails if a link or a picture of a built site leads to a file or a place in it that is not there.

    check_links.py FOLDER

The reference by Doxygen (cpp/) is only a target: Doxygen checks its own links.
"""

from __future__ import annotations

import sys
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class Page(HTMLParser):
    """The places of a page, and the targets of its links."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.places: set[str] = {""}
        self.links: set[str] = set()
        self.feed(path.read_text())

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        for name, value in attributes:
            if value is None:
                continue
            if name == "id" or (name == "name" and tag == "a"):
                self.places.add(value)
            elif name in ("href", "src"):
                self.links.add(value)


@cache
def page(path: Path) -> Page:
    return Page(path)


def fault(source: Path, link: str) -> str | None:
    parts = urlsplit(link)
    if parts.scheme or parts.netloc:
        return None
    target = source if not parts.path else (source.parent / unquote(parts.path)).resolve()
    if target.is_dir():
        target /= "index.html"
    if not target.exists():
        return "no such file"
    if target.suffix == ".html" and unquote(parts.fragment) not in page(target).places:
        return "no such place"
    return None


def main() -> int:
    folder = Path(sys.argv[1]).resolve()
    pages = [p for p in sorted(folder.rglob("*.html")) if p.relative_to(folder).parts[0] != "cpp" and p.name != "404.html"]
    faults = links = 0
    for source in pages:
        for link in sorted(page(source).links):
            links += 1
            if what := fault(source, link):
                print(f"{source.relative_to(folder)}: {link}: {what}", file=sys.stderr)
                faults += 1
    print(f"{links} links of {len(pages)} pages, {faults} lead nowhere")
    return 1 if faults or not links else 0


if __name__ == "__main__":
    sys.exit(main())
