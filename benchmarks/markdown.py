"""A table in Markdown whose rows are printed as they come, and kept in a file where one is named."""

import subprocess
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path


class Table:
    """Printed at once and row by row; an interrupted run leaves in the file what it has measured.

    Args:
        columns: their heads.
        command: what made the table; it stands above it in the file, with day and revision.
        out: the file, None: only printed.
    """

    def __init__(self, columns: Sequence[str], command: str, out: Path | None = None) -> None:
        self._out = out
        if out is not None:
            out.write_text(f"`{command}` (as root), {datetime.now(UTC):%Y-%m-%d}, {revision()}\n\n")
        self.add(columns)
        self.line("|---" * len(columns) + "|")

    def add(self, cells: Sequence[object]) -> None:
        """A row."""
        self.line(f"| {' | '.join(map(str, cells))} |")

    def line(self, text: str) -> None:
        """A line that is no row, such as one below the table."""
        print(text, flush=True)
        if self._out is not None:
            with self._out.open("a") as file:
                file.write(f"{text}\n")


def revision() -> str:
    """Of the source, or empty where that is not known."""
    try:
        done = subprocess.run(
            ["git", "describe", "--always", "--dirty", "--exclude=*"],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
    except OSError:
        return ""
    return done.stdout.strip()
