"""Output of a command: the answer on stdout; progress, remarks and errors on stderr.

Text from outside is never markup. Colours and bars are for a terminal only (and NO_COLOR takes the colours);
elsewhere stderr gets plain lines. `--json` and `--quiet` are set with `output`, where a command begins.
"""

import json
import os
import shlex
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import IO, TYPE_CHECKING

from forefeel.common.events.console import printable

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.table import Table

Show = Callable[[float, str], None]
_CLEAR = b"\r\x1b[2K\x1b[?25h"  # takes a bar from a terminal and gives the cursor back
PLAIN_WIDTH = 160
"""Columns of a table where there is no terminal."""
SHADES = {"green": "green", "amber": "yellow", "red": "bold red"}
"""Colour of a level of `forefeel doctor`, of a certificate and of a line on stderr."""


class _Mode:
    as_json: bool = False
    quiet: bool = False


_mode = _Mode()


@contextmanager
def output(as_json: bool = False, quiet: bool = False) -> Iterator[None]:
    """Sets how all threads print while the body runs. `as_json`: the answer as one JSON document; `quiet`:
    errors only, an answer only as document.
    """
    before = _mode.as_json, _mode.quiet
    _mode.as_json, _mode.quiet = as_json, quiet
    try:
        yield
    finally:
        _mode.as_json, _mode.quiet = before


def say(text: str) -> None:
    """Prints a remark: one line on stderr, none with `--quiet`."""
    if not _mode.quiet:
        ask(text)


def suggest(*words: object, head: str = "next", **options: object) -> None:
    """Prints a remark: the command to type next, `forefeel` with these words and options; nothing beside a
    document or with `--quiet`.

    Args:
        head: when, or where, it is to be typed.
        options: by their names; True: a flag; a list: repeated; None and False: left out.
    """
    line = ["forefeel", *words]
    for name, value in options.items():
        for item in value if isinstance(value, list) else [value]:
            if item is not None and item is not False:
                line += [f"--{name.replace('_', '-')}", item][: 1 if item is True else 2]
    if not _mode.as_json:
        say(f"{head}: {shlex.join(map(str, line))}")


def ask(text: str) -> None:
    """Prints a line on stderr, even with `--quiet`: somebody has to act on it. No error without terminal."""
    with suppress(OSError):
        print(printable(text), file=sys.stderr, flush=True)


def complain(text: str) -> None:
    """Prints an error in one line, whatever `text` is broken into."""
    _headed("forefeel:", SHADES["red"], text)


def flush() -> None:
    for stream in sys.stdout, sys.stderr:
        with suppress(OSError):
            stream.flush()


def last_word(text: str) -> None:
    """Prints the error of a process that ends at once, wherever it is, without Python's streams."""
    terminal = os.isatty(2)
    with suppress(OSError):
        os.write(2, (_CLEAR if terminal else b"") + f"forefeel: {printable(text)}\n".encode())


def warn(text: str) -> None:
    """Prints a line on stderr about what works with less than it should."""
    if not _mode.quiet:
        _headed("amber:", SHADES["amber"], text)


def _headed(head: str, style: str, text: str) -> None:
    """Prints a text in one line on stderr, behind a head that has the style `style` on a terminal."""
    line = f" {printable(' '.join(text.splitlines()))}"
    if not sys.stderr.isatty():
        ask(f"{head}{line}")
        return
    from rich.text import Text  # noqa: PLC0415 - as in `console`

    with suppress(OSError):
        console(sys.stderr).print(Text.assemble((head, style), line), soft_wrap=True)


def answer(*parts: "RenderableType", document: Callable[[], object]) -> None:
    """Prints the answer on stdout: tables, texts and lines; with `--json` the document alone.

    Args:
        parts: each begins a line of its own; lines are not wrapped, tables fit the terminal.
        document: gives what JSON can hold, or the text of a JSON document.
    """
    if _mode.as_json:
        content = document()
        print(content.rstrip("\n") if isinstance(content, str) else json.dumps(content, indent=2), flush=True)
    else:
        show(*parts)


def show(*parts: "RenderableType") -> None:
    """Prints tables, texts and lines on stdout, of an answer that comes in pieces or has no document; nothing
    with `--json` or `--quiet`.
    """
    if _mode.as_json or _mode.quiet or not parts:
        return
    shown = console(sys.stdout)
    from rich.table import Table  # noqa: PLC0415 - as in `console`

    for part in parts:
        shown.print(part, soft_wrap=not isinstance(part, Table))
    sys.stdout.flush()


def console(stream: IO[str]) -> "Console":
    """Makes a rich console of a stream without markup; only a stream that is a terminal counts as one,
    whatever the environment says, and else it is `PLAIN_WIDTH` wide.
    """
    from rich.console import Console  # noqa: PLC0415 - a daemon and an emergency stop start without rich

    terminal = stream.isatty()
    width = None if terminal else PLAIN_WIDTH
    return Console(
        file=stream, force_terminal=terminal, width=width, highlight=False, markup=False, emoji=False
    )


def table(*columns: str, title: str | None = None, right: Sequence[str] = ()) -> "Table":
    """Makes an empty table for stdout. `right`: columns of numbers, aligned right and cut off; texts wrap."""
    from rich import box  # noqa: PLC0415 - as in `console`
    from rich.table import Table  # noqa: PLC0415

    style = box.SIMPLE_HEAD if sys.stdout.isatty() else box.ASCII2
    made = Table(title=title, title_justify="left", box=style)
    for name in columns:
        if name in right:
            made.add_column(name, justify="right", no_wrap=True)
        else:
            made.add_column(name, overflow="fold")
    return made


@contextmanager
def bar(total: float, count: str = "{task.completed:.0f} / {task.total:.0f}") -> Iterator[Show]:
    """Shows a progress bar on stderr for the length of the block, if that is a terminal and not `--quiet`.
    Gives a function that takes how much of `total` is done, and what is going on; without a bar it does
    nothing. `count`: rich's format of the count. An answer meanwhile goes to stdout, where that is no
    terminal.
    """
    if _mode.quiet or not sys.stderr.isatty():
        yield lambda _done, _what: None
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn  # noqa: PLC0415 - as in `console`

    with Progress(
        TextColumn("{task.description:>12}", markup=False),
        BarColumn(bar_width=40),
        TextColumn(count),
        TimeRemainingColumn(),
        console=console(sys.stderr),
        transient=True,
        redirect_stdout=sys.stdout.isatty(),
    ) as shown:
        task = shown.add_task("starting", total=total)
        yield lambda done, what: shown.update(task, completed=min(done, total), description=what)
