"""Small pieces of Markdown that the pages of the reference share. Pure."""

import inspect
import re
from collections.abc import Iterable, Sequence

NOTE = "<!-- Made from the code by docs/hooks. -->\n"
_SECTIONS = re.compile(r"^(Attributes|Raises|Use):\s*$")
_ITEM = re.compile(r"\d+\. ")
_FENCE = re.compile(r"^( *)```")
_ENTRY = re.compile(r"^ {4}(\w+): ")


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table; line breaks and bars in a cell are made harmless."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(map(_cell, line))} |\n" for line in lines)


def code(text: object) -> str:
    """As code; a text with a backtick, which the pages do not have, is refused."""
    shown = str(text)
    if "`" in shown:
        raise ValueError(f"{shown!r}: expected text without a backtick")
    return f"`{shown}`" if shown else ""


def prose(text: str | None) -> str:
    """A docstring as paragraphs; `Attributes:` becomes a list."""
    lines = inspect.cleandoc(text or "").splitlines()
    shown = (f"- `{m[1]}`: {line[m.end() :]}" if (m := _ENTRY.match(line)) else line for line in lines)
    return "\n".join("" if _SECTIONS.match(line) else line for line in shown).strip()


def _cell(text: str) -> str:
    parts = re.split(r"(`[^`]*`)", " ".join(text.split()))  # a bar within code parts no cells
    return "".join(part if part.startswith("`") else part.replace("|", "\\|") for part in parts)


def nested(markdown: str) -> str:
    """What stands in an item of a numbered list, indented by three blanks, with the four that the site's
    Markdown wants, and with an empty line around each code block and before the next item.
    """
    shown, fence = list[str](), None
    for line in markdown.splitlines():
        found = _FENCE.match(line)
        begins, ends = found and fence is None, found and fence is not None
        if found and begins:
            fence = found[1]
        if fence is None and _ITEM.match(line) and shown and shown[-1].startswith("    "):
            shown.append("")
        inner = f" {line}" if line.startswith("   ") and fence != "" else line
        shown += ["", inner] if begins and fence else [inner, ""] if ends and fence else [inner]
        fence = None if ends else fence
    return "\n".join(shown) + "\n"
