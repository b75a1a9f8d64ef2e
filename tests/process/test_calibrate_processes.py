"""`forefeel emulate` and `forefeel calibrate` as processes of their own; a script hangs the weights."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import date
from pathlib import Path

import pytest

from forefeel.common.hardware.calibration import CellScale, load_cell_calibration
from forefeel.devices.bota.driver import BotaSerialLoadCell
from forefeel.devices.bota.settings import BotaSettings
from forefeel.slave.load_cell import LoadCellReading
from tests.waiting import PATIENCE_S, wait_until

SLAVE = """role: slave
axes:
- load_cell: {driver: bota_serial, port: PORT, full_scale_n: 10, sign: -1, rate_hz: 200, serial: B-7}
"""
LOADS = "0", "4", "0"


@contextmanager
def process(*words: str) -> Iterator[subprocess.Popen[str]]:
    pipe = subprocess.PIPE
    child = subprocess.Popen(
        [sys.executable, "-m", "forefeel", *words], stdin=pipe, stdout=pipe, stderr=pipe, text=True
    )
    try:
        yield child
    finally:
        child.kill()
        child.communicate()


def say(child: subprocess.Popen[str], line: str) -> None:
    assert child.stdin is not None
    child.stdin.write(line + "\n")
    child.stdin.flush()


@pytest.mark.soak
def test_a_bota_cell(tmp_path: Path) -> None:
    config, out, port = tmp_path / "slave.yaml", tmp_path / "cell.yaml", tmp_path / "cell"
    config.write_text(SLAVE.replace("PORT", str(port)))
    words = ["--config", str(config), "--axis", "insertion", "--out", str(out), "--settle", "0.1"]
    with process("emulate", "bota_serial", "--config", str(config)) as emulator:
        assert emulator.stdout is not None and emulator.stderr is not None
        assert emulator.stdout.readline() == f"bota_serial on {port} at 460800 baud\n"
        say(emulator, "load heavy")
        assert emulator.stderr.readline() == (
            "forefeel: 'load heavy': expected a force in N, such as load 1.5\n"
        )
        with process("calibrate", "load-cell", *words, "--forces", "4") as calibrating:
            assert calibrating.stderr is not None
            for load in LOADS:
                while not calibrating.stderr.readline().endswith("then press Enter\n"):
                    assert calibrating.poll() is None
                say(emulator, f"load {load}")
                say(calibrating, "")
            assert calibrating.wait(PATIENCE_S) == 0
        found = load_cell_calibration(out, "bota_serial", "B-7", date.today(), CellScale(1.0, 10.0))
        assert found.gain_n == pytest.approx(1.0, rel=1e-3)
        assert found.zero == pytest.approx(0.0, abs=0.002)
        say(emulator, "load 2.5")
        cell = BotaSerialLoadCell(
            BotaSettings(
                driver="bota_serial",
                port=str(port),
                full_scale_n=10,
                sign=-1,
                rate_hz=200,
                serial="B-7",
                calibration=out,
            )
        )
        cell.open()
        readings: list[LoadCellReading] = []

        def heard() -> bool:
            readings.extend(cell.read(0, None))
            return len(readings) > 2

        try:
            wait_until(heard)
        finally:
            cell.close()
        assert readings[-1].force_n == pytest.approx(2.5, abs=0.02)
        say(emulator, "unplug")
        wait_until(lambda: not port.is_symlink())
