"""The table of the faults in docs/explanation/faults.md."""

import os
import re
from collections.abc import Sequence
from pathlib import Path

from tests.system.faults.scene import Row

HEAD = ("fault", "required s", "to rest s", "from mm/s", "stale commands executed", "oldest ms",
        "moved after rest um", "force faded s", "from N", "recovery", "armed again s", "recording", "events",
        "")  # fmt: skip
MEASURED = "Measured by `make system`\n"


def cells(row: Row) -> tuple[str, ...]:
    """In the order of HEAD."""
    return (
        row.name,
        _number(row.asked_s, 3) or "goes on",
        _number(row.rest_s, 3),
        _number(row.speed_m_s * 1e3, 0),
        _number(row.stale, 0),
        _number(None if row.excess_s is None else row.excess_s * 1e3, 0),
        _number(None if row.moved_again_m is None else row.moved_again_m * 1e6, 0),
        _number(row.faded_s, 2),
        _number(row.force_n, 2),
        row.recovery,
        _number(row.armed_s, 1),
        row.recording,
        row.logged,
        "FAILED" if row.failures else "as required",
    )


def written(
    page: Path, measured: Sequence[tuple[str, ...]], names: Sequence[str], command: str, took_min: float
) -> str:
    """The page with these rows; those of it that were not measured now, but still exist, stay as they are."""
    old = page.read_text(encoding="utf-8")
    before, rest = old.split(MEASURED)
    _, table, explained = rest.split("\n\n", 2)
    kept = [tuple(line.strip("| ").split(" | ")) for line in table.splitlines()]
    rows = {row[0]: row for row in [*kept, *measured]}
    lines = [HEAD, tuple("---" for _ in HEAD), *(rows[name] for name in names if name in rows)]
    now = f"{len(measured)} rows by `{command}` in {took_min:.0f} min"
    others = ", the others in earlier runs" if len(measured) < len(names) else ""
    table = "\n".join(f"| {' | '.join(row)} |" for row in lines)
    return f"{before}{MEASURED}on {_machine()}: {now}{others}.\n\n{table}\n\n{explained}"


def _machine() -> str:
    model = re.search(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    return f"{os.cpu_count()} cores{'' if model is None else f' of {model[1]}'}, Linux {os.uname().release}"


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"
