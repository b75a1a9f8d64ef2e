"""The table of the faults in docs/explanation/faults.md."""

import os
import re
from collections.abc import Sequence
from pathlib import Path

from tests.system.faults.scene import Row

HEAD = ("fault", "to rest s", "armed again s", "recovery")
MEASURED = "Measured by `make system`\n"


def cells(row: Row) -> tuple[str, ...]:
    """In the order of HEAD."""
    rest = "goes on" if row.asked_s is None else f"{_number(row.rest_s, 3)} of {row.asked_s:.3f}"
    return row.name, rest, _number(row.armed_s, 1), "FAILED" if row.failures else row.recovery


def figures(row: Row) -> str:
    """All that was measured."""
    found = (
        (row.rest_s, 1.0, "s to rest"),
        (row.speed_m_s, 1e3, "mm/s before"),
        (row.stale, 1.0, "stale commands executed"),
        (row.excess_s, 1e3, "ms oldest"),
        (row.moved_again_m, 1e6, "um moved after rest"),
        (row.faded_s, 1.0, "s force faded"),
        (row.force_n, 1.0, "N before"),
    )
    numbers = [f"{value * scale:.3g} {unit}" for value, scale, unit in found if value is not None]
    return "; ".join(filter(None, [*numbers, row.recovery, row.recording, row.logged]))


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
