"""The page of faults, of which single rows are measured anew."""

from tests.system.faults.__main__ import renewed
from tests.system.faults.scene import Row

PAGE = "# Faults\n\n| fault | to rest s |\n| --- | --- |\n| one | 1 |\n| two | 2 |\n\nText.\n"


def test_a_row_is_renewed_in_place_and_a_new_one_stands_behind_the_last() -> None:
    rows = [Row("one", "started again", 0.2), Row("three", "by itself", None), Row("four", "by itself", None)]
    lines = renewed(PAGE, rows, "python -m tests.system.faults").splitlines()
    table = [line.split(" | ")[0] for line in lines if line.startswith("| ")]
    assert table == ["| fault", "| ---", "| one", "| two", "| three", "| four"]
    assert "| started again |" in lines[4] and lines[5] == "| two | 2 |"
    assert lines[-3:] == [
        "Measured since, by `python -m tests.system.faults`: one; three; four.",
        "",
        "Text.",
    ]
