"""`forefeel calibrate` on emulated devices in stepped time: the file says what they were made with."""

from collections.abc import Iterator
from contextlib import ExitStack
from datetime import date
from pathlib import Path
from typing import Any

import pytest
import yaml

from forefeel.calibrate.load_cell import LoadCellCalibrationOptions, run_load_cell
from forefeel.calibrate.stage import StageCalibrationOptions, run_stage
from forefeel.common.config import load_settings
from forefeel.common.hardware.calibration import LoadCellCalibration, StageCalibration
from forefeel.common.hardware.driver import Slot, installed_driver
from forefeel.common.runtime.real import HOST
from forefeel.testing import EmulatedBench, SteppedTime, stepped

TODAY = date(2026, 2, 1)


@pytest.fixture
def time(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[SteppedTime]:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(type(HOST), "prepare_thread", lambda host, priority: "left alone")
    with stepped() as time:
        yield time


def on_bench(slot: Slot, name: str, time: SteppedTime, leave: ExitStack, **changed: Any) -> EmulatedBench:  # noqa: ANN401
    """The emulated device, and the slave's file that names it with some settings changed."""
    bench = EmulatedBench(installed_driver(slot, name), Path.cwd(), time, leave)
    section = {**bench.settings.model_dump(mode="json", exclude_none=True), **changed}
    axis = {slot: section, "limits": {"workspace_m": [0.001, 0.009], "max_force_n": 3.0}}
    Path("slave.yaml").write_text(yaml.safe_dump({"role": "slave", "axes": [axis]}))
    return bench


@pytest.mark.parametrize(
    ("name", "changed", "native_per_m"),
    [
        ("zaber_ascii", {"travel_m": [0.0, 0.01]}, 1e7),
        ("cia402", {"travel_m": [0.0, 0.01], "following_error_m": 0.005}, 1e7),
    ],
)
def test_stage_is_homed_and_measured(
    time: SteppedTime, name: str, changed: dict[str, Any], native_per_m: float
) -> None:
    with ExitStack() as leave:
        on_bench("stage", name, time, leave, **changed)
        options = StageCalibrationOptions(Path("slave.yaml"), "insertion", Path("stage.yaml"), yes=True)
        run_stage(options, time, TODAY)
    found = load_settings(StageCalibration, Path("stage.yaml"))
    assert (found.driver, found.date, found.native_per_m) == (name, TODAY, native_per_m)
    assert found.travel_m[0] <= 0.0 and found.travel_m[1] >= 0.01


@pytest.mark.parametrize(
    ("name", "changed", "gain_n"),
    [
        ("ascii_line", {"serial": "L-4"}, 4.4482216e-3),
        ("bota_serial", {"serial": "B-7"}, 1.0),
        ("cia404", {}, 1.0),
    ],
)
def test_load_cell_gives_its_loads_back(
    time: SteppedTime, name: str, changed: dict[str, Any], gain_n: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    loads = iter([0.0, 4.0, 0.0])
    with ExitStack() as leave:
        bench = on_bench("load_cell", name, time, leave, **changed)
        monkeypatch.setattr(
            "forefeel.calibrate.load_cell.ask_person",
            lambda *_: setattr(bench.around.load, "force_n", next(loads)),
        )
        options = LoadCellCalibrationOptions(
            Path("slave.yaml"), "insertion", Path("cell.yaml"), forces="4", settle_s=0.2
        )
        run_load_cell(options, time, TODAY)
    found = load_settings(LoadCellCalibration, Path("cell.yaml"))
    assert [found.force_n(native) for native, _ in found.points] == pytest.approx([0.0, 4.0, 0.0], abs=0.01)
    assert found.gain_n == pytest.approx(gain_n, rel=0.02) and found.zero * gain_n == pytest.approx(
        0.0, abs=0.01
    )
