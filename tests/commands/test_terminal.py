"""What a terminal gets and what a pipe gets; markup from outside; completion by the shell."""

import io
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from forefeel import terminal
from tests.secured import make_pki

Run = Callable[[Sequence[str]], int]
COLOUR = ("\x1b[3", "\x1b[1;3", "\x1b[9")


class Terminal(io.StringIO):
    """A stream that is a terminal."""

    def isatty(self) -> bool:
        return True


def test_a_table_is_coloured_on_a_terminal_alone(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_pki(tmp_path / "pki")
    monkeypatch.setenv("TERM", "xterm-256color")
    for out, no_colour in ((Terminal(), ""), (Terminal(), "1"), (io.StringIO(), "")):
        monkeypatch.setattr(sys, "stdout", out)
        monkeypatch.setenv("NO_COLOR", no_colour)  # empty: as if it were not there
        assert run(["pki", "show", str(tmp_path / "pki")]) == 0
        assert "slave.crt" in out.getvalue()
        wanted = out.isatty() and not no_colour
        assert any(start in out.getvalue() for start in COLOUR) == wanted


@pytest.mark.parametrize("made", [io.StringIO, Terminal])
def test_text_from_outside_is_no_markup_and_no_command_to_a_terminal(
    made: type[io.StringIO], monkeypatch: pytest.MonkeyPatch
) -> None:
    text = "[red]a[/red] :smile: [link=x]b"
    out, err = made(), made()
    monkeypatch.setattr(sys, "stdout", out)
    monkeypatch.setattr(sys, "stderr", err)
    terminal.answer(text, document=dict)
    terminal.say(f"{text}\x1b[2J")
    terminal.complain(f"{text}\x1b[2J\nand more")
    assert out.getvalue() == f"{text}\n"
    said, complaint = err.getvalue().splitlines()
    assert said == f"{text}?[2J"
    assert complaint.endswith(f" {text}?[2J and more")


def test_a_long_line_is_not_wrapped_and_a_table_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    out = io.StringIO()
    monkeypatch.setattr(sys, "stdout", out)
    table = terminal.table("a", "b")
    table.add_row("x" * 300, "y")
    terminal.answer("z" * 300, table, document=dict)
    long, *rows = out.getvalue().splitlines()
    assert long == "z" * 300
    assert max(map(len, rows)) == terminal.PLAIN_WIDTH
    assert sum(row.count("x") for row in rows) == 300
