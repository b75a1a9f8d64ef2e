"""`forefeel calibrate` as a person uses it, on fakes and on emulated devices, in stepped time."""

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from datetime import date
from pathlib import Path
from typing import Any

import pytest
import yaml

from forefeel.calibrate.procedure import Target, run_load_cell, run_stage
from forefeel.common.config import load_settings
from forefeel.common.errors import ConfigurationError
from forefeel.common.hardware.calibration import (
    LoadCellCalibration,
    StageCalibration,
    load_cell_calibration,
    stage_calibration,
)
from forefeel.common.hardware.driver import InstalledDriver, Slot, installed_driver
from forefeel.common.runtime.real import HOST
from forefeel.common.state.folder import LATCHED, StateFolder
from forefeel.common.yaml_file import load_yaml
from forefeel.devices.simulated.settings import SimulatedStageSettings
from forefeel.slave.load_cell import NativeReading
from forefeel.testing import EmulatedBench, SteppedTime, stepped
from tests.devices.fake_devices import UNPLUGGED, FakeCell, FakeHoming, Hands, S, SteppedClock

Run = Callable[[Sequence[str]], int]
FORCES = ["--forces", "1,2,4"]
WALK = [0.0, 1.0, 2.0, 4.0, 2.0, 1.0, 0.0]
SLAVE = """role: slave
axes:
- stage: {driver: zaber_ascii, port: /dev/stage, microstep_m: 1e-6, travel_m: [0, 0.09], sign: SIGN}
  load_cell: {driver: ascii_line, port: /dev/cell, unit: counts, full_scale_n: 10, sign: SIGN,
    full_scale_native: 500_000, pushes_only: true, filter_lag_s: 0}
  gripper: {driver: simulated}
  limits: {workspace_m: [0, 0.08]}
"""
CELL = ["calibrate", "load-cell", "--config", "slave.yaml", "--axis", "insertion", "--out", "cell.yaml"]
STAGE = ["calibrate", "stage", "--config", "slave.yaml", "--axis", "insertion", "--out", "stage.yaml"]


def configure(sign: int = 1) -> None:
    Path("slave.yaml").write_text(SLAVE.replace("SIGN", str(sign)))


def unwritten() -> bool:
    return [path.name for path in Path().iterdir()] == ["slave.yaml"]


@pytest.fixture
def cell(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> FakeCell:
    clock = SteppedClock()
    cell = FakeCell(clock)
    monkeypatch.setattr(InstalledDriver, "make", lambda *_: cell)
    monkeypatch.setattr("forefeel.calibrate.procedure.MonotonicClock", lambda: clock)
    monkeypatch.setattr(sys, "stdin", Hands(cell, WALK))
    monkeypatch.chdir(tmp_path)
    configure()
    return cell


@pytest.mark.parametrize("sign", [1, -1])
def test_load_cell_is_calibrated_and_its_file_gives_the_loads_back(
    run: Run, cell: FakeCell, capsys: pytest.CaptureFixture[str], sign: int
) -> None:
    configure(sign)
    cell.gain_n *= sign
    assert run([*CELL, *FORCES]) == 0
    said = capsys.readouterr()
    found = load_cell_calibration(Path("cell.yaml"), "ascii_line", "SN-7", date.today(), cell.scale)
    assert found.gain_n == pytest.approx(2e-5, rel=1e-4)
    assert [sign * found.force_n(native) for native, _ in found.points] == pytest.approx(WALK, abs=1e-3)
    assert [force_n for _, force_n in found.points] == WALK
    assert found.zero == pytest.approx(cell.zero, abs=3.0)
    assert (found.range_n, found.valid_days) == ((0.0, 4.0), 365)
    assert 0.0 < found.residual_n < 1e-4
    assert said.err.count("press Enter") == len(WALK)
    assert cell.calls == ["open", "close"]


def test_weights_are_kilograms_and_with_yes_nobody_is_asked(
    run: Run, cell: FakeCell, monkeypatch: pytest.MonkeyPatch
) -> None:
    loads = iter([0.0, 0.980665, 0.0])
    monkeypatch.setattr("forefeel.calibrate.procedure.ask_person", lambda *_: cell.load(next(loads)))
    assert run([*CELL, "--weights", "0,0.1", "--yes"]) == 0
    found = load_settings(LoadCellCalibration, Path("cell.yaml"))
    assert found.gain_n == pytest.approx(cell.gain_n, rel=1e-3)
    assert found.range_n == pytest.approx((0.0, 0.980665))


def test_what_came_before_enter_is_of_the_load_before(
    run: Run, cell: FakeCell, monkeypatch: pytest.MonkeyPatch
) -> None:
    loads, queued = iter([0.0, 0.1, 0.0]), list[NativeReading]()

    def hang(*_: object) -> None:
        cell.clock.set_ns(cell.clock.now_ns() + 5 * S)
        queued.extend(cell.read_native(cell.clock.now_ns()))
        cell.load(next(loads))

    def read(now_ns: int) -> list[NativeReading]:
        cell.clock.set_ns(now_ns + 1)
        earlier, queued[:] = queued[:], []
        return [*earlier, *FakeCell.read_native(cell, now_ns)]

    monkeypatch.setattr("forefeel.calibrate.procedure.ask_person", hang)
    monkeypatch.setattr(cell, "read_native", read)
    assert run([*CELL, "--forces", "0.1", "--settle", "0"]) == 0
    assert load_settings(LoadCellCalibration, Path("cell.yaml")).gain_n == pytest.approx(2e-5, rel=1e-3)


def test_json_is_what_the_file_holds_and_quiet_only_asks(
    run: Run, cell: FakeCell, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run([*CELL, *FORCES, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["format"] == "forefeel.load_cell_calibration/1"
    assert document == yaml.safe_load(json.dumps(load_yaml(Path("cell.yaml"))[0], default=str))
    monkeypatch.setattr(sys, "stdin", Hands(cell, WALK))
    assert run([*CELL, *FORCES, "--quiet", "--overwrite"]) == 0
    said = capsys.readouterr()
    assert (said.out, len(said.err.splitlines())) == ("", len(WALK))


@pytest.mark.parametrize(
    ("attribute", "value", "code", "word"),
    [
        ("drift_per_s", 3000.0, 1, "drift"),  # 0.06 N/s
        ("gain_n", -2e-5, 1, "sign"),
        ("zero", 500_100.0, 1, "zero = 500100"),
        ("valid", False, 1, "not valid"),
        ("rate_hz", 0.1, 1, "at least 10"),
        ("fails_at_s", 4.0, 1, "unplugged"),
        ("serial", "", 2, "no serial number"),
    ],
)
def test_cell_that_can_not_be_calibrated_writes_nothing(
    run: Run,
    cell: FakeCell,
    capsys: pytest.CaptureFixture[str],
    attribute: str,
    value: object,
    code: int,
    word: str,
) -> None:
    setattr(cell, attribute, value)
    assert run([*CELL, *FORCES]) == code
    assert word in capsys.readouterr().err.splitlines()[-1]
    assert unwritten()
    assert cell.calls == ["open", "close"]


def test_stdin_that_ends_ends_the_calibration(
    run: Run, cell: FakeCell, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stdin", Hands(cell, WALK[:2]))
    assert run([*CELL, *FORCES]) == 1
    assert unwritten()


BAD_LOADS = [
    [],
    ["--weights", "1", "--forces", "1"],
    ["--weights", "0,abc"],
    ["--weights", "0,-1"],
    ["--weights", "0"],
    ["--weights", "0,,1"],
    ["--weights", "1,1"],
    ["--weights", "1,nan"],
    ["--forces", "11"],
]
BAD_OPTIONS = [
    ["--max-residual", "0.5"],
    ["--settle", "nan"],
    ["--valid-days", "0"],
    ["--out", "cell.txt"],
    ["--out", "no/cell.yaml"],
    ["--out", "slave.yaml"],
    ["--axis", "roll"],
    ["--config", "none.yaml"],
]


@pytest.mark.parametrize("words", [*BAD_LOADS, *([*FORCES, *words] for words in BAD_OPTIONS)], ids=" ".join)
def test_bad_input_is_one_line_before_the_cell_is_opened(
    run: Run, cell: FakeCell, capsys: pytest.CaptureFixture[str], words: list[str]
) -> None:
    assert run([*CELL, *words]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert unwritten()
    assert cell.calls == []


def test_simulated_cell_has_nothing_to_calibrate(run: Run, cell: FakeCell) -> None:
    Path("slave.yaml").write_text("role: slave\n")
    assert run([*CELL, *FORCES]) == 2


def test_earlier_file_is_replaced_only_with_overwrite(run: Run, cell: FakeCell) -> None:
    Path("cell.yaml").write_text("earlier")
    assert run([*CELL, *FORCES]) == 2
    assert Path("cell.yaml").read_text() == "earlier"
    assert run([*CELL, *FORCES, "--overwrite"]) == 0
    assert load_settings(LoadCellCalibration, Path("cell.yaml")).serial == "SN-7"
    assert sorted(path.name for path in Path().iterdir()) == ["cell.yaml", "slave.yaml"]


# --- the file, when it is loaded ---


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"date": "2020-01-01"}, "out of date"),
        ({"serial": "SN-8"}, "serial = 'SN-8'"),
        ({"gain_n": float("nan")}, "gain_n"),
        ({"gain_n": 0.0}, "gain_n = 0.0"),
        ({"gain_n": 5e-5}, "gain_n = 5e-05"),
        ({"zero": -500_100.0}, "zero = -500100"),
        ({"serial": ""}, "serial = ''"),
        ({"date": "2999-01-01"}, "date = 2999-01-01"),
        ({"driver": "bota_serial"}, "driver = 'bota_serial'"),
        ({"format": "forefeel.stage_calibration/1"}, "format"),
    ],
)
def test_calibration_that_does_not_fit_is_refused(
    run: Run, cell: FakeCell, change: dict[str, object], word: str
) -> None:
    assert run([*CELL, *FORCES]) == 0
    path = Path("cell.yaml")
    path.write_text(yaml.safe_dump({**yaml.safe_load(path.read_text()), **change}))
    with pytest.raises(ConfigurationError) as refused:
        load_cell_calibration(path, "ascii_line", "SN-7", date.today(), cell.scale)
    assert word in str(refused.value)


# --- stages ---


@pytest.fixture
def homing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> FakeHoming:
    homing = FakeHoming(SteppedClock())
    monkeypatch.setattr(InstalledDriver, "make_homing", lambda *_: homing)
    monkeypatch.setattr(sys, "stdin", Hands(says=["yes\n"]))
    monkeypatch.chdir(tmp_path)
    configure()
    return homing


@pytest.mark.parametrize(("sign", "ends_m"), [(1, (-0.001, 0.099)), (-1, (-0.099, 0.001))])
def test_a_stage_is_homed_twice_and_run_from_end_to_end(
    run: Run, homing: FakeHoming, sign: int, ends_m: tuple[float, float]
) -> None:
    configure(sign)
    if sign < 0:
        text = Path("slave.yaml").read_text()
        Path("slave.yaml").write_text(
            text.replace("[0, 0.09]", "[-0.09, 0]").replace("[0, 0.08]", "[-0.08, 0]")
        )
    assert run([*STAGE, "--velocity", "0.01"]) == 0
    found = stage_calibration(Path("stage.yaml"), "zaber_ascii", "SN-7", date.today(), ends_m, 1e6)
    assert found.travel_m == pytest.approx(ends_m)
    assert found.native_per_m == pytest.approx(1e6)
    assert found.zero == 0.0
    assert homing.calls == ["open", "homed", "travelled at 0.01", "homed", "stop", "close"]


@pytest.mark.parametrize("serial", ["SN-7", ""])
def test_home_homes_and_does_no_more(run: Run, homing: FakeHoming, serial: str) -> None:
    homing.serial = serial
    assert run(["home", "--config", "slave.yaml", "--axis", "insertion", "--yes"]) == 0
    assert homing.calls == ["open", "homed", "stop", "close"]


def test_a_stage_without_a_serial_number_is_not_calibrated_and_does_not_move(
    run: Run, homing: FakeHoming
) -> None:
    homing.serial = ""
    assert run([*STAGE, "--yes"]) == 2
    assert homing.calls == ["open", "stop", "close"]
    assert unwritten()


def test_stage_json_is_what_the_file_holds_and_quiet_says_nothing(
    run: Run, homing: FakeHoming, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run([*STAGE, "--yes", "--json"]) == 0
    found = StageCalibration.model_validate_json(capsys.readouterr().out)
    assert found == load_settings(StageCalibration, Path("stage.yaml"))
    assert homing.calls.count("homed") == 2
    assert run([*STAGE, "--yes", "--quiet", "--overwrite"]) == 0
    assert capsys.readouterr() == ("", "")


def test_a_stage_does_not_move_beside_a_slave_or_while_a_stop_is_latched(
    run: Run, homing: FakeHoming, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    Path("slave.yaml").write_text(Path("slave.yaml").read_text() + "state: {directory: st}\n")
    with StateFolder(tmp_path / "st"):
        assert run(STAGE) == 2
    assert "in use by another daemon" in capsys.readouterr().err
    (tmp_path / "st" / LATCHED).write_text('{"latched": {"insertion": "nurse: pressed"}}')
    assert run(STAGE) == 1
    assert "an emergency stop is latched (insertion: nurse: pressed)" in capsys.readouterr().err
    assert homing.calls == []
    (tmp_path / "st" / LATCHED).write_text('{"latched": {}}')
    assert run(STAGE) == 0


@pytest.mark.parametrize("answer", ["no\n", "\n", None])
def test_a_stage_does_not_move_without_a_yes(
    run: Run, homing: FakeHoming, monkeypatch: pytest.MonkeyPatch, answer: str | None
) -> None:
    monkeypatch.setattr(sys, "stdin", Hands(says=[] if answer is None else [answer]))
    assert run(STAGE) == 1
    assert homing.calls == ["open", "stop", "close"]
    assert unwritten()


@pytest.mark.parametrize(
    ("flaw", "message"),
    [
        ("short", "travel -1.000 to 50.000 mm"),
        ("fault", "unplugged"),
        ("interrupt", "interrupted"),
    ],
)
def test_a_stage_that_fails_is_stopped_and_nothing_is_written(
    run: Run, homing: FakeHoming, capsys: pytest.CaptureFixture[str], flaw: str, message: str
) -> None:
    match flaw:
        case "short":
            homing.ends = (-1000.0, 50_000.0)
        case "fault":
            homing.stuck = UNPLUGGED
        case _:
            homing.stuck = KeyboardInterrupt()
    assert run(STAGE) == 1
    assert message in capsys.readouterr().err.splitlines()[-1]
    assert homing.calls[-2:] == ["stop", "close"]
    assert unwritten()


@pytest.mark.parametrize(
    "words", [["--velocity", "1"], ["--out", "slave.yaml"], ["--valid-days", "0"]], ids=" ".join
)
def test_bad_input_is_refused_before_the_stage_is_opened(
    run: Run, homing: FakeHoming, words: list[str]
) -> None:
    assert run([*STAGE, *words]) == 2
    assert homing.calls == []


def test_a_driver_that_can_not_be_homed_from_here_says_so() -> None:
    driver = installed_driver("stage", "simulated")
    with pytest.raises(ConfigurationError):
        driver.make_homing(SimulatedStageSettings(), SteppedClock())


# --- emulated devices ---


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
    rest = {each: {"driver": "simulated"} for each in ("load_cell", "gripper")}
    axis = {**rest, slot: section, "limits": {"workspace_m": [0.001, 0.009], "max_force_n": 3.0}}
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
        target = Target(Path("slave.yaml"), "insertion", Path("stage.yaml"), yes=True)
        run_stage(target, 0.005, clock=time)
    found = load_settings(StageCalibration, Path("stage.yaml"))
    assert (found.driver, found.native_per_m) == (name, native_per_m)
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
            "forefeel.calibrate.procedure.ask_person",
            lambda *_: setattr(bench.around.load, "force_n", next(loads)),
        )
        target = Target(Path("slave.yaml"), "insertion", Path("cell.yaml"))
        run_load_cell(target, None, "4", settle_s=0.2, clock=time)
    found = load_settings(LoadCellCalibration, Path("cell.yaml"))
    assert [found.force_n(native) for native, _ in found.points] == pytest.approx([0.0, 4.0, 0.0], abs=0.01)
    assert found.gain_n == pytest.approx(gain_n, rel=0.02) and found.zero * gain_n == pytest.approx(
        0.0, abs=0.01
    )
