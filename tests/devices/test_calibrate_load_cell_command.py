"""`forefeel calibrate load-cell` as a person uses it, on a fake in stepped time."""

import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import date
from pathlib import Path

import pytest
import yaml

from forefeel.common.config import load_settings
from forefeel.common.errors import ConfigurationError
from forefeel.common.hardware.calibration import LoadCellCalibration, load_cell_calibration
from forefeel.common.hardware.driver import InstalledDriver
from forefeel.common.settings import DaemonSettings
from forefeel.common.yaml_file import load_yaml
from forefeel.daemon_settings import load_daemon
from forefeel.loopback.plan import LoopbackOptions, make_plan
from forefeel.probe.configured import calibrations
from tests.devices.calibrate_bench import CELL, configure, unwritten
from tests.devices.fake_devices import FakeCell, Hands, SteppedClock

Run = Callable[[Sequence[str]], int]
FORCES = ["--forces", "1,2,4"]
WALK = [0.0, 1.0, 2.0, 4.0, 2.0, 1.0, 0.0]


@pytest.fixture
def cell(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> FakeCell:
    clock = SteppedClock()
    cell = FakeCell(clock)
    monkeypatch.setattr(InstalledDriver, "make", lambda *_: cell)
    monkeypatch.setattr("forefeel.calibrate.load_cell.MonotonicClock", lambda: clock)
    monkeypatch.setattr(sys, "stdin", Hands(cell, WALK))
    monkeypatch.chdir(tmp_path)
    configure()
    return cell


@pytest.mark.parametrize("sign", [1, -1])
def test_a_load_cell_is_calibrated_and_the_file_gives_the_loads_back(
    run: Run, cell: FakeCell, capsys: pytest.CaptureFixture[str], sign: int
) -> None:
    configure(sign)
    cell.gain_n *= sign
    assert run([*CELL, *FORCES, "--temperature", "21.5"]) == 0
    said = capsys.readouterr()
    found = load_cell_calibration(Path("cell.yaml"), "ascii_line", "SN-7", date.today(), cell.scale)
    assert found.gain_n == pytest.approx(2e-5, rel=1e-4)
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
    monkeypatch.setattr("forefeel.calibrate.load_cell.ask_person", lambda *_: cell.load(next(loads)))
    assert run([*CELL, "--weights", "0,0.1", "--yes"]) == 0
    found = load_settings(LoadCellCalibration, Path("cell.yaml"))
    assert found.gain_n == pytest.approx(cell.gain_n, rel=1e-3)
    assert found.range_n == pytest.approx((0.0, 0.980665))


def test_json_is_what_the_file_holds_and_quiet_asks_and_says_no_more(
    run: Run, cell: FakeCell, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run([*CELL, *FORCES, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["format"] == "forefeel.load_cell_calibration/1"
    assert document == yaml.safe_load(json.dumps(load_yaml(Path("cell.yaml"))[0], default=str))
    monkeypatch.setattr(sys, "stdin", Hands(cell, WALK))
    assert run([*CELL, *FORCES, "--quiet", "--overwrite"]) == 0
    said = capsys.readouterr()
    assert said.out == ""
    assert len(said.err.splitlines()) == len(WALK)
    assert all(line.endswith("then press Enter") for line in said.err.splitlines())


@pytest.mark.parametrize(
    ("attribute", "value", "message"),
    [
        ("drift_per_s", 3000.0, "no load: the reading moves: drift"),  # 0.06 N/s
        ("gain_n", -2e-5, "the reading goes the wrong way with load_cell.sign = 1"),
        ("zero", 500_100.0, "zero = 500100: expected at most 500000 native units"),
        ("valid", False, "no load: readings that are not valid"),
        ("rate_hz", 0.1, "3 readings within 30 s: expected at least 10"),
        ("fails_at_s", 4.0, "a fake: unplugged"),
    ],
)
def test_cell_that_can_not_be_calibrated_writes_nothing(
    run: Run, cell: FakeCell, capsys: pytest.CaptureFixture[str], attribute: str, value: object, message: str
) -> None:
    setattr(cell, attribute, value)
    assert run([*CELL, *FORCES]) == 1
    said = capsys.readouterr().err
    assert said.splitlines()[-1].startswith(f"forefeel: {message}")
    assert attribute != "drift_per_s" or said.count("press Enter") == 1  # refused at once
    assert unwritten()
    assert cell.calls == ["open", "close"]


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
    expected = "load_cell.driver = 'simulated': nothing to calibrate; expected one of ascii_line, bota_serial"
    assert expected in capsys.readouterr().err


def test_a_cell_without_a_serial_number_is_refused(
    run: Run, cell: FakeCell, capsys: pytest.CaptureFixture[str]
) -> None:
    cell.serial = ""
    assert run([*CELL, *FORCES]) == 2
    assert "insertion load_cell on /dev/cell: no serial number" in capsys.readouterr().err
    assert unwritten()


def test_earlier_file_is_replaced_only_when_it_may_be(run: Run, cell: FakeCell) -> None:
    Path("cell.yaml").write_text("earlier")
    assert run([*CELL, *FORCES]) == 2
    assert Path("cell.yaml").read_text() == "earlier"
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
        ({"gain_n": 0.0}, "gain_n = 0.0"),
        ({"gain_n": 5e-5}, "gain_n = 5e-05: expected 1e-05 to 4e-05"),
        ({"zero": -500_100.0}, "zero = -500100: expected at most 500000 native units"),
        ({"serial": ""}, "serial = ''"),
        ({"date": "2999-01-01"}, "date = 2999-01-01: expected at most today"),
        ({"driver": "bota_serial"}, "driver = 'bota_serial': expected 'ascii_line'"),
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
        load_cell_calibration(path, "ascii_line", "SN-7", date.today(), cell.scale)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


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
    plan = make_plan(LoopbackOptions(duration_s=0.5))
    assert list(plan.tables()) == ["run"]
    devices = load_yaml(Path("slave.yaml"))[0]["axes"]
    devices[0]["load_cell"]["calibration"] = str(Path("cell.yaml").resolve())
    tables = replace(plan, slave={**plan.slave, "axes": devices}).tables()
    assert tables["run"] == plan.metadata
    assert tables["calibration insertion/load_cell"]["serial"] == "SN-7"
