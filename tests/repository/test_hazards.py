"""Each hazard of docs/explanation/safety.md names what shows its measure, and that exists."""

import re
from collections.abc import Iterator

import pytest

from tests.repository.pages import DOCS, ROOT

SEVERITIES = {"A", "B", "C"}
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in (DOCS / "explanation" / "safety.md").read_text().splitlines()
    if line.count("|") == 7 and not line.startswith(("| hazard", "|---"))
]
FAULTS = {
    line.split("|")[1].strip()
    for line in (DOCS / "explanation" / "faults.md").read_text().splitlines()
    if line.startswith("| ")
}
SYSTEM = "\n".join(path.read_text() for path in (ROOT / "tests" / "system").rglob("*.py"))


def missing(name: str) -> Iterator[str]:
    """What there is not of a test, a benchmark or a row of `make system`."""
    if name.startswith("python -m benchmarks."):
        if not (ROOT / f"{name.removeprefix('python -m ').replace('.', '/')}.py").is_file():
            yield name
    elif ".py" in name:
        place, _, test = name.partition("::")
        file = ROOT / "tests" / place
        if not file.is_file() or f"def {test or 'test_'}" not in file.read_text():
            yield name
    elif name not in FAULTS and f'"{name}"' not in SYSTEM:
        yield name


def test_the_table_is_read() -> None:
    assert len(ROWS) > 25
    assert list(missing("unit/test_gate.py::test_nothing_of_that_name"))
    assert list(missing("a row that nobody has"))


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0])
def test_each_hazard_names_what_shows_its_measure(row: list[str]) -> None:
    hazard, severity, measure, _, _, shown = row
    assert hazard
    assert measure
    assert severity in SEVERITIES
    names = re.findall(r"`([^`]+)`", shown)
    assert names
    assert [each for name in names for each in missing(name)] == []
