"""The load cell of docs/how-to/own-driver.md, with a file in the place of the device."""

import time
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from forefeel.common.errors import DeviceError
from forefeel.slave.load_cell import LoadCellReading
from tests.repository.pages import DOCS

Cell = Any  # the example is no package of ours


@pytest.fixture
def raw(tmp_path: Path) -> Path:
    file = tmp_path / "in_voltage0_raw"
    file.write_text("84000\n")
    return file


@pytest.fixture
def cell(raw: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Cell]:
    monkeypatch.syspath_prepend(DOCS / "examples" / "load-cell-driver")
    driver, settings_of = import_module("forefeel_iio.driver"), import_module("forefeel_iio.settings")
    settings = settings_of.IioSettings(
        driver="iio", file=raw, newton_per_count=5e-6, zero_counts=84000, full_scale_n=10, rate_hz=200
    )
    made = driver.IioLoadCell(settings)
    yield made
    made.close()


def newest(cell: Cell, wanted: Callable[[LoadCellReading], bool]) -> LoadCellReading:
    """The first reading that is as wanted, within 5 s."""
    end = time.monotonic() + 5.0
    while time.monotonic() < end:
        for reading in cell.read(0, None):
            if wanted(reading):
                return LoadCellReading(*reading)
        time.sleep(0.005)
    raise AssertionError("no such reading")


def test_it_gives_newtons_with_stamps_and_believes_no_overload(cell: Cell, raw: Path) -> None:
    cell.open()
    assert newest(cell, lambda reading: reading.valid).force_n == 0.0
    before_ns = time.monotonic_ns()
    replaced(raw, "484000\n")
    loaded = newest(cell, lambda reading: reading.force_n > 1.0)
    assert loaded.force_n == pytest.approx(2.0)
    assert loaded.valid
    assert before_ns < (loaded.stamp_ns or 0) < time.monotonic_ns()
    replaced(raw, "9000000\n")
    assert not newest(cell, lambda reading: reading.force_n > 9.0).valid


def test_after_a_fault_it_waits_to_be_rearmed(cell: Cell, raw: Path) -> None:
    cell.open()
    replaced(raw, "nothing\n")
    with pytest.raises(DeviceError, match="expected a file with an integer"):
        newest(cell, lambda reading: False)
    replaced(raw, "84000\n")
    end = time.monotonic() + 5.0
    while cell.link.state.name != "CONFIGURED" and time.monotonic() < end:
        time.sleep(0.01)
    with pytest.raises(DeviceError):
        cell.read(0, None)
    cell.rearm()
    assert newest(cell, lambda reading: reading.valid).force_n == 0.0


def test_a_cell_that_is_not_there_is_refused_at_once(cell: Cell, raw: Path) -> None:
    raw.unlink()
    with pytest.raises(DeviceError, match="No such file"):
        cell.open()


def replaced(raw: Path, text: str) -> None:
    """At once, as a device does: no reader meets an empty file."""
    beside = raw.with_suffix(".new")
    beside.write_text(text)
    beside.replace(raw)
