"""`forefeel calibrate` as a person uses it, on fakes in stepped time."""

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import date
from pathlib import Path

import pytest
import yaml

from common.config import load_settings, load_yaml
from common.errors import ConfigurationError
from common.hardware.calibration import (
    LoadCellCalibration,
    StageCalibration,
    load_cell_calibration,
    stage_calibration,
)
from common.settings import DaemonSettings
from forefeel.calibrate.carried import calibrations
from forefeel.daemon_settings import load_daemon
from forefeel.devices.drivers import Driver
from forefeel.loopback.plan import Wish, make_plan
from tests.hardware.fake_devices import UNPLUGGED, FakeCell, FakeHoming, Hands, SteppedClock

Run = Callable[[Sequence[str]], int]
SLAVE = """role: slave
axes:
- stage: {driver: zaber_ascii, port: /dev/stage, microstep_m: 1e-6, travel_m: [0, 0.09], sign: SIGN}
  load_cell: {driver: ascii_line, port: /dev/cell, unit: counts, full_scale_n: 10, sign: SIGN}
  limits: {workspace_m: [0, 0.08]}
"""
CELL = ["calibrate", "load-cell", "--config", "slave.yaml", "--axis", "insertion", "--out", "cell.yaml"]
STAGE = ["calibrate", "stage", "--config", "slave.yaml", "--axis", "insertion", "--out", "stage.yaml"]
FORCES = ["--forces", "1,2,4"]
WALK = [0.0, 1.0, 2.0, 4.0, 2.0, 1.0, 0.0]


def configure(sign: int = 1) -> None:
    Path("slave.yaml").write_text(SLAVE.replace("SIGN", str(sign)))


def unwritten() -> bool:
    return [path.name for path in Path().iterdir()] == ["slave.yaml"]


@pytest.fixture
def cell(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> FakeCell:
    clock = SteppedClock()
    cell = FakeCell(clock)
    monkeypatch.setattr(Driver, "make", lambda *_: cell)
    monkeypatch.setattr("forefeel.calibrate.load_cell.MonotonicClock", lambda: clock)
    monkeypatch.setattr(sys, "stdin", Hands(cell, WALK))
    monkeypatch.chdir(tmp_path)
    configure()
    return cell


@pytest.fixture
def homing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> FakeHoming:
    homing = FakeHoming(SteppedClock())
    monkeypatch.setattr(Driver, "make_homing", lambda *_: homing)
    monkeypatch.setattr(sys, "stdin", Hands(says=["yes\n"]))
    monkeypatch.chdir(tmp_path)
    configure()
    return homing


# --- the load cell ---


@pytest.mark.parametrize("sign", [1, -1])
def test_a_load_cell_is_calibrated_and_the_file_gives_the_loads_back(
    run: Run, cell: FakeCell, capsys: pytest.CaptureFixture[str], sign: int
) -> None:
    configure(sign)
    assert run([*CELL, *FORCES, "--temperature", "21.5"]) == 0
    said = capsys.readouterr()
    found = load_cell_calibration(Path("cell.yaml"), "SN-7", date.today())
    assert found.gain_n == pytest.approx(sign * cell.gain_n, rel=1e-4)
    assert [sign * found.force_n(native) for native, _ in found.points] == pytest.approx(WALK, abs=1e-3)
    assert [force_n for _, force_n in found.points] == WALK
    assert found.zero == pytest.approx(cell.zero, abs=3.0)
    assert found.driver == "ascii_line"
    assert found.date == date.today()
    assert found.range_n == (0.0, 4.0)
    assert found.temperature_c == 21.5
    assert 0.0 < found.residual_n < 1e-4
    assert "serial SN-7" in said.err
    prompts = [line for line in said.err.splitlines() if line.endswith("then press Enter")]
    assert len(prompts) == len(WALK)
    assert prompts[0] == "Unload the cell, then press Enter"
    assert prompts[3] == "Apply 4 N (0.40789 kg), then press Enter"
    assert said.out.splitlines()[-1] == f"cell.yaml: serial SN-7, {date.today()}, valid 365 days"
    assert cell.calls == ["open", "close"]


def test_weights_are_kilograms_and_with_yes_nobody_is_asked(
    run: Run, cell: FakeCell, monkeypatch: pytest.MonkeyPatch
) -> None:
    loads = iter([0.0, 0.980665, 0.0])
    monkeypatch.setattr("forefeel.calibrate.person.Person.wait", lambda *_: cell.load(next(loads)))
    assert run([*CELL, "--weights", "0,0.1", "--yes"]) == 0
    found = load_settings(LoadCellCalibration, Path("cell.yaml"))
    assert found.gain_n == pytest.approx(cell.gain_n, rel=1e-3)
    assert found.range_n == pytest.approx((0.0, 0.980665))


def test_hysteresis_is_reported(run: Run, cell: FakeCell) -> None:
    cell.lag = 0.02
    assert run([*CELL, *FORCES, "--max-residual", "0.05"]) == 0
    found = load_settings(LoadCellCalibration, Path("cell.yaml"))
    assert found.hysteresis_n == pytest.approx(0.06, rel=0.1)  # 2 N: after 1 N and after 4 N


def test_a_slow_cell_is_read_until_there_are_enough_readings(run: Run, cell: FakeCell) -> None:
    cell.rate_hz = 5.0
    assert run([*CELL, *FORCES]) == 0


def drifting(cell: FakeCell) -> None:
    cell.drift_per_s = 3000.0  # 0.06 N/s


def noisy(cell: FakeCell) -> None:
    cell.noise = 8000.0


def bent(cell: FakeCell) -> None:
    cell.bend = 0.5


def dead(cell: FakeCell) -> None:
    cell.gain_n = 1e9


def overrange(cell: FakeCell) -> None:
    cell.valid = False


def silent(cell: FakeCell) -> None:
    cell.rate_hz = 0.1


def unplugged(cell: FakeCell) -> None:
    cell.fails_at_s = 4.0


@pytest.mark.parametrize(
    ("flaw", "message"),
    [
        (drifting, "no load: the reading moves: drift"),
        (noisy, "no load: the reading moves: noise"),
        (bent, "residual "),
        (dead, "1 N: the reading does not follow the load: "),
        (overrange, "no load: readings that are not valid"),
        (silent, "3 readings within 30 s: expected at least 10"),
        (unplugged, "a fake: unplugged"),
    ],
)
def test_what_can_not_be_calibrated_is_refused_in_one_line_and_nothing_is_written(
    run: Run,
    cell: FakeCell,
    capsys: pytest.CaptureFixture[str],
    flaw: Callable[[FakeCell], None],
    message: str,
) -> None:
    flaw(cell)
    assert run([*CELL, *FORCES]) == 1
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith(f"forefeel: {message}")
    assert unwritten()
    assert cell.calls == ["open", "close"]


def test_a_tare_that_moves_is_refused_at_once_where_the_scale_is_known(
    run: Run, cell: FakeCell, capsys: pytest.CaptureFixture[str]
) -> None:
    drifting(cell)
    cell.newton_per_native = 2e-5
    assert run([*CELL, *FORCES]) == 1
    assert capsys.readouterr().err.count("press Enter") == 1


def test_stdin_that_ends_ends_the_calibration(
    run: Run, cell: FakeCell, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stdin", Hands(cell, WALK[:2]))
    assert run([*CELL, *FORCES]) == 1
    last = capsys.readouterr().err.splitlines()[-1]
    assert last == (
        "forefeel: stdin ended at 'Apply 2 N (0.20394 kg)': expected a line, or --yes; nothing was written"
    )
    assert unwritten()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "--weights, --forces: expected one of them"),
        (["--weights", "1", "--forces", "1"], "--weights, --forces: expected one of them"),
        (["--weights", "0,abc"], "--weights 0,abc: expected numbers with commas, such as 0,0.05,0.1"),
        (["--weights", "0,-1"], "--weights 0,-1: a weight below 0; expected kg, or --forces in N"),
        (["--weights", "0"], "--weights 0: one point, no load; expected at least one load besides 0"),
        (["--forces", "11"], "load 11 N: expected at most load_cell.full_scale_n = 10 N"),
        ([*FORCES, "--max-residual", "0.5"], "--max-residual 0.5: expected 1e-06 to 0.1 of the range"),
        ([*FORCES, "--average", "0.1"], "--average 0.1: expected 0.5 to 60 s"),
        ([*FORCES, "--out", "cell.txt"], "--out cell.txt: suffix '.txt', expected .yaml"),
        ([*FORCES, "--out", "no/cell.yaml"], "--out no/cell.yaml: expected a folder that exists"),
        ([*FORCES, "--out", "slave.yaml"], "--out slave.yaml: exists, expected a new file, or --overwrite"),
        (
            [*FORCES, "--axis", "roll"],
            "--axis roll: slave.yaml has none of that name; expected one of insertion",
        ),
        ([*FORCES, "--config", "none.yaml"], "none.yaml: No such file or directory"),
    ],
)
def test_bad_input_is_one_line_before_the_cell_is_opened(
    run: Run, cell: FakeCell, capsys: pytest.CaptureFixture[str], words: list[str], message: str
) -> None:
    assert run([*CELL, *words]) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert said.startswith(f"forefeel: {message}")
    assert unwritten()
    assert cell.calls == []


def test_a_simulated_cell_has_nothing_to_calibrate(
    run: Run, cell: FakeCell, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("slave.yaml").write_text("role: slave\n")
    assert run([*CELL, *FORCES]) == 2
    expected = "load_cell.driver = 'simulated': nothing to calibrate; expected one of bota_serial, ascii_line"
    assert expected in capsys.readouterr().err


def test_a_cell_without_a_serial_number_is_refused(
    run: Run, cell: FakeCell, capsys: pytest.CaptureFixture[str]
) -> None:
    cell.serial = ""
    assert run([*CELL, *FORCES]) == 2
    assert "insertion load_cell on /dev/cell: no serial number" in capsys.readouterr().err
    assert unwritten()


def test_an_earlier_file_stays_unless_it_may_go_and_stays_whole_when_refused(
    run: Run, cell: FakeCell
) -> None:
    Path("cell.yaml").write_text("earlier")
    assert run([*CELL, *FORCES]) == 2
    bent(cell)
    assert run([*CELL, *FORCES, "--overwrite"]) == 1
    assert Path("cell.yaml").read_text() == "earlier"


def test_an_earlier_file_is_replaced_when_it_may_be(run: Run, cell: FakeCell) -> None:
    Path("cell.yaml").write_text("earlier")
    assert run([*CELL, *FORCES, "--overwrite"]) == 0
    assert load_settings(LoadCellCalibration, Path("cell.yaml")).serial == "SN-7"
    assert sorted(path.name for path in Path().iterdir()) == ["cell.yaml", "slave.yaml"]


# --- the file, when it is loaded ---


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"date": "2020-01-01"}, "date = 2020-01-01: out of date by"),
        ({"serial": "SN-8"}, "serial = 'SN-8': expected 'SN-7', the device that answers"),
        ({"gain_n": float("nan")}, "gain_n"),
        ({"format": "forefeel.stage_calibration/1"}, "format = 'forefeel.stage_calibration/1'"),
    ],
)
def test_a_calibration_that_does_not_fit_is_one_line_that_says_what_to_do(
    run: Run, cell: FakeCell, change: dict[str, object], message: str
) -> None:
    assert run([*CELL, *FORCES]) == 0
    path = Path("cell.yaml")
    path.write_text(yaml.safe_dump({**yaml.safe_load(path.read_text()), **change}))
    with pytest.raises(ConfigurationError) as refused:
        load_cell_calibration(path, "SN-7", date.today())
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


# --- the stage ---


@pytest.mark.parametrize(("sign", "ends_m"), [(1, (-0.001, 0.099)), (-1, (-0.099, 0.001))])
def test_a_stage_is_homed_twice_and_run_from_end_to_end(
    run: Run,
    homing: FakeHoming,
    capsys: pytest.CaptureFixture[str],
    sign: int,
    ends_m: tuple[float, float],
) -> None:
    configure(sign)
    if sign < 0:
        text = Path("slave.yaml").read_text()
        Path("slave.yaml").write_text(
            text.replace("[0, 0.09]", "[-0.09, 0]").replace("[0, 0.08]", "[-0.08, 0]")
        )
    assert run([*STAGE, "--velocity", "0.01"]) == 0
    found = stage_calibration(Path("stage.yaml"), "SN-7", date.today())
    assert found.travel_m == pytest.approx(ends_m)
    assert found.native_per_m == pytest.approx(1e6)
    assert found.zero == 0.0
    assert found.repeatability_m == pytest.approx(3e-6)
    assert homing.calls == ["open", "homed", "travelled at 0.01", "homed", "stop", "close"]
    said = capsys.readouterr()
    assert "90 mm by its settings, at 10 mm/s" in said.err
    assert "found again within 3 um" in said.out


def test_a_device_that_does_not_tell_its_repeatability_has_none_in_the_file(
    run: Run, homing: FakeHoming, capsys: pytest.CaptureFixture[str]
) -> None:
    homing.off = None
    assert run([*STAGE, "--yes"]) == 0
    assert load_settings(StageCalibration, Path("stage.yaml")).repeatability_m is None
    assert "not told by the device" in capsys.readouterr().out


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
        ("short", "travel -1.000 to 50.000 mm found, settings say stage.travel_m = [0.0, 0.09]"),
        ("off", "home found again 60.0 um off, allowed 50.0 um"),
        ("fault", "unplugged"),
        ("interrupt", "calibration interrupted; the stage was stopped, nothing was written"),
    ],
)
def test_a_stage_that_fails_is_stopped_and_nothing_is_written(
    run: Run, homing: FakeHoming, capsys: pytest.CaptureFixture[str], flaw: str, message: str
) -> None:
    match flaw:
        case "short":
            homing.ends = (-1000.0, 50_000.0)
        case "off":
            homing.off = 60.0
        case "fault":
            homing.stuck = UNPLUGGED
        case _:
            homing.stuck = KeyboardInterrupt()
    assert run(STAGE) == 1
    assert capsys.readouterr().err.splitlines()[-1].startswith(f"forefeel: {message}")
    assert homing.calls[-2:] == ["stop", "close"]
    assert unwritten()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--velocity", "1"], "--velocity 1: expected 0.0001 to 0.05"),
        (["--out", "slave.yaml"], "--out slave.yaml: exists, expected a new file, or --overwrite"),
        (["--valid-days", "0"], "--valid-days 0: expected 1 to 3650"),
    ],
)
def test_bad_input_is_one_line_before_the_stage_is_opened(
    run: Run, homing: FakeHoming, capsys: pytest.CaptureFixture[str], words: list[str], message: str
) -> None:
    assert run([*STAGE, *words]) == 2
    assert capsys.readouterr().err == f"forefeel: {message}\n"
    assert homing.calls == []


def test_a_driver_that_can_not_be_homed_from_here_says_so(
    run: Run, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    scale = "counts_per_m: 1e6, travel_m: [0, 0.2]"
    can = f"{{driver: cia402, can: {{interface: virtual, channel: x}}, node_id: 3, {scale}}}"
    limits = "{workspace_m: [0, 0.08]}"
    Path("slave.yaml").write_text(f"role: slave\naxes:\n- stage: {can}\n  limits: {limits}\n")
    assert run([*STAGE, "--yes"]) == 2
    assert capsys.readouterr().err == (
        "forefeel: stage.driver = 'cia402': can not be homed from here; use its maker's tools\n"
    )


# --- the recording ---


def calibrated(run: Run) -> DaemonSettings:
    assert run([*CELL, *FORCES]) == 0
    text = Path("slave.yaml").read_text().replace("unit: counts", "unit: counts, calibration: cell.yaml")
    Path("slave.yaml").write_text(text)
    return load_daemon(Path("slave.yaml"))


def test_the_calibrations_of_a_daemon_are_tables_for_its_recording(run: Run, cell: FakeCell) -> None:
    tables = calibrations(calibrated(run))
    assert list(tables) == ["calibration insertion/load_cell"]
    found = tables["calibration insertion/load_cell"]
    file = load_settings(LoadCellCalibration, Path("cell.yaml"))
    assert (found["file"], found["serial"], found["date"]) == ("cell.yaml", "SN-7", str(date.today()))
    numbers = [float(found[name]) for name in ("gain_n", "zero", "residual_n", "hysteresis_n")]
    assert numbers == [file.gain_n, file.zero, file.residual_n, file.hysteresis_n]
    assert found["range_n"] == "0.0 4.0"


def test_a_recorded_loopback_carries_the_calibrations(run: Run, cell: FakeCell) -> None:
    assert calibrated(run)
    plan = make_plan(Wish(duration_s=0.5))
    assert list(plan.tables()) == ["run"]
    devices = load_yaml(Path("slave.yaml"))[0]["axes"]
    devices[0]["load_cell"]["calibration"] = str(Path("cell.yaml").resolve())
    tables = replace(plan, slave={**plan.slave, "axes": devices}).tables()
    assert tables["run"] == plan.metadata
    assert tables["calibration insertion/load_cell"]["serial"] == "SN-7"
