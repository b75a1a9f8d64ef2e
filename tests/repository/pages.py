"""The documentation as the tests see it: every page, its prose, its code blocks, the pages that are made."""

import re
import unicodedata
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from docs.hooks import reference

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
WRITTEN = sorted(
    [*DOCS.rglob("*.md"), *(ROOT / "firmware").glob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
)

_FENCE = re.compile(r"^(\s*)```(\w*)\s*$")
_HEADING = re.compile(r"^#{1,6} +(.*?)(?:\s*\{ #([\w-]+) \})?\s*$", re.MULTILINE)


class Block(NamedTuple):
    """A code block: where it begins, its language (empty: none was named), its lines without the indent."""

    page: str
    line: int
    language: str
    text: str


@cache
def made() -> dict[Path, str]:
    """What the hook makes: path -> Markdown."""
    return {DOCS / path: text for path, text in reference.pages().items()}


def text_of(path: Path) -> str:
    return made()[path] if path in made() else path.read_text(encoding="utf-8")


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


def blocks(path: Path) -> Iterator[Block]:
    begun, lines, indent, language = 0, list[str](), "", ""
    for number, line in enumerate(text_of(path).splitlines(), 1):
        fence = _FENCE.match(line)
        if begun and fence and not fence[2]:
            yield Block(name_of(path), begun, language, "\n".join(lines) + "\n")
            begun, lines = 0, []
        elif begun:
            lines.append(line.removeprefix(indent))
        elif fence:
            begun, indent, language = number, fence[1], fence[2]
    assert not begun, f"{name_of(path)}:{begun}: a code block without an end"


def prose(path: Path) -> str:
    """The page without its code blocks."""
    kept, inside = [], False
    for line in text_of(path).splitlines():
        if _FENCE.match(line):
            inside = not inside
        elif not inside:
            kept.append(line)
    return "\n".join(kept)


def anchors(path: Path) -> list[str]:
    """Of every heading, as the site and the hosts of repositories make them."""
    return [given or _slug(title) for title, given in _HEADING.findall(prose(path))]


def _slug(title: str) -> str:
    plain = unicodedata.normalize("NFKD", title).encode("ascii", "ignore").decode()
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", plain).strip().lower())
