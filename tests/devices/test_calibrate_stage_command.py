"""`forefeel calibrate stage` as a person uses it, on a fake in stepped time."""

import sys
from collections.abc import Callable, Sequence
from datetime import date
from pathlib import Path

import pytest

from forefeel.common.config import load_settings
from forefeel.common.errors import ConfigurationError
from forefeel.common.hardware.calibration import StageCalibration, stage_calibration
from forefeel.common.hardware.driver import InstalledDriver, installed_driver
from forefeel.common.state.folder import LATCHED, StateFolder
from forefeel.devices.simulated.settings import SimulatedStageSettings
from tests.devices.calibrate_bench import STAGE, configure, unwritten
from tests.devices.fake_devices import UNPLUGGED, FakeHoming, Hands, SteppedClock

Run = Callable[[Sequence[str]], int]


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
    found = stage_calibration(Path("stage.yaml"), "zaber_ascii", "SN-7", date.today(), ends_m, 1e6)
    assert found.travel_m == pytest.approx(ends_m)
    assert found.native_per_m == pytest.approx(1e6)
    assert found.zero == 0.0
    assert found.repeatability_m == pytest.approx(3e-6)
    assert homing.calls == ["open", "homed", "travelled at 0.01", "homed", "stop", "close"]
    said = capsys.readouterr()
    assert "90 mm by its settings, at 10 mm/s" in said.err
    assert "found again within 3 um" in said.out


def test_json_is_what_the_file_holds_and_quiet_says_nothing(
    run: Run, homing: FakeHoming, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run([*STAGE, "--yes", "--json"]) == 0
    found = StageCalibration.model_validate_json(capsys.readouterr().out)
    assert found == load_settings(StageCalibration, Path("stage.yaml"))
    assert homing.calls.count("homed") == 2
    assert run([*STAGE, "--yes", "--quiet", "--overwrite"]) == 0
    assert capsys.readouterr() == ("", "")


def test_a_device_that_does_not_tell_its_repeatability_has_none_in_the_file(
    run: Run, homing: FakeHoming, capsys: pytest.CaptureFixture[str]
) -> None:
    homing.off = None
    assert run([*STAGE, "--yes"]) == 0
    assert load_settings(StageCalibration, Path("stage.yaml")).repeatability_m is None
    assert "not told by the device" in capsys.readouterr().out


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


def test_a_driver_that_can_not_be_homed_from_here_says_so() -> None:
    driver = installed_driver("stage", "simulated")
    with pytest.raises(ConfigurationError, match=r"'simulated': can not be homed from here; use its maker's"):
        driver.make_homing(SimulatedStageSettings(), SteppedClock())
