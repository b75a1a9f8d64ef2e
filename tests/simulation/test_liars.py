"""Devices that lie in the demo; `python -m benchmarks.liars` has all of them, and all healthy ones."""

from pathlib import Path

from benchmarks.liars import LIARS, demo, hidden, run


def test_reversed_load_cell_is_a_fault_before_the_limit() -> None:
    found = run(demo("catheter"), LIARS["cell: sign reversed"])
    assert "load_cell.sign" in found.fault
    assert found.most_n < 0.1 * 3.0


def test_healthy_devices_are_believed_whatever_is_hidden(tmp_path: Path) -> None:
    hide = hidden("stribeck_friction", tmp_path)
    found = run(demo("catheter", hide=hide, hide_at_s=2.0))
    assert (found.fault, found.deviation_m < 2e-5) == ("", True)
