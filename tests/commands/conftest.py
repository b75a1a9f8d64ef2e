"""The command line in a folder of the test."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.commands.command_line import contents

NO_FILES: dict[str, str] = {}


class Shown(NamedTuple):
    code: int
    out: str
    err: str


class Shell:
    """Runs lines in its folder; `@` stands for the folder, for paths that must be absolute."""

    def __init__(
        self, folder: Path, run: Callable[[Sequence[str]], int], capsys: pytest.CaptureFixture[str]
    ) -> None:
        self.folder, self._run, self._capsys = folder, run, capsys

    def __call__(self, line: str | Sequence[str]) -> Shown:
        words = line.replace("@", str(self.folder)).split() if isinstance(line, str) else line
        self._capsys.readouterr()
        return Shown(self._run(words), *self._capsys.readouterr())

    def write(self, files: dict[str, str]) -> None:
        for name, text in files.items():
            (self.folder / name).parent.mkdir(exist_ok=True)
            (self.folder / name).write_text(text)

    def refused(self, line: str, words: Sequence[str] = (), files: dict[str, str] = NO_FILES) -> None:
        """The line, beside these files, exits with 2, says one line with these words and leaves nothing."""
        self.write(files)
        before = contents(self.folder)
        shown = self(line)
        assert (shown.code, shown.out) == (2, "")
        assert shown.err.startswith("forefeel: ")
        assert shown.err.count("\n") == 1
        for word in words:
            assert word in shown.err
        assert contents(self.folder) == before


@pytest.fixture
def shell(
    run: Callable[[Sequence[str]], int],
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> Shell:
    monkeypatch.chdir(tmp_path)
    return Shell(tmp_path, run, capsys)
