"""Our serial drivers with their own threads on pseudo terminals: held, unplugged, plugged, re-armed."""

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from forefeel.common.errors import DeviceError, DeviceSetupError
from forefeel.common.hardware.link import LinkState
from forefeel.devices.ascii_line.driver import AsciiLineLoadCell
from forefeel.devices.ascii_line.emulator import EmulatedLineCell
from forefeel.devices.ascii_line.settings import AsciiLineSettings
from forefeel.devices.coil.driver import CoilHandle
from forefeel.devices.coil.emulator import CoilDevice, CoilHardware
from forefeel.devices.emulation.sensing import EmulatedSensor
from forefeel.devices.emulation.wire import EmulatedDevice
from forefeel.devices.shared import stream as streams
from forefeel.devices.shared.settings import SerialSettings
from forefeel.devices.shared.stream import SerialStream
from forefeel.devices.zaber.driver import ZaberStage
from forefeel.devices.zaber.emulator import ZaberDevice
from tests.devices.coil_rig import coil_settings
from tests.devices.zaber_rig import MODEL, settings
from tests.emulators.threads import on_pty
from tests.waiting import wait_until

CALM_S = 2.0
"""A watchdog that a busy machine does not trip by itself: longer than settings and a real device allow."""


def coil(port: str) -> CoilHandle:
    return CoilHandle(coil_settings(port=port).model_copy(update={"watchdog_s": CALM_S}))


def loadstar(port: str) -> AsciiLineLoadCell:
    given = {"driver": "ascii_line", "port": port, "unit": "millipound_force", "request": "O0W1"}
    chosen = {**given, "full_scale_n": 10, "rate_hz": 2, "baud": 115_200}  # silence begins after 2.5 s
    return AsciiLineLoadCell(AsciiLineSettings.model_validate(chosen))


def read(device: Any) -> object:  # noqa: ANN401 - of any slot
    now_ns = time.monotonic_ns()
    return device.read(now_ns, None) if hasattr(device, "stale_s") else device.read(now_ns)


@pytest.mark.parametrize(
    ("emulated", "make", "baud"),
    [
        (ZaberDevice(MODEL), lambda port: ZaberStage(settings(port=port)), 115_200),
        (
            EmulatedLineCell(EmulatedSensor(lambda _: 1.0, 150.0), "millipound_force", "O0W1"),
            loadstar,
            115_200,
        ),
        (CoilDevice(CoilHardware(longest_watchdog_ms=round(1e3 * CALM_S))), coil, 2_000_000),
    ],
    ids=["zaber", "ascii_line", "coil"],
)
def test_serial_driver_is_unplugged_plugged_and_rearmed(
    tmp_path: Path, emulated: EmulatedDevice, make: Callable[[str], Any], baud: int
) -> None:
    with pytest.raises(DeviceSetupError, match="no such port"):
        make(str(tmp_path / "none")).open()
    with on_pty(emulated, tmp_path, baud) as port:
        device = make(port.path)
        device.open()
        try:
            with pytest.raises(DeviceSetupError, match="busy"):
                make(port.path).open()
            read(device)
            port.do(port.pty.unplug)
            wait_until(lambda: device.link.inhibited)
            with pytest.raises(DeviceError):
                read(device)
            port.do(port.pty.plug)
            wait_until(lambda: device.link.state is LinkState.CONFIGURED)
            with pytest.raises(DeviceError):
                read(device)
            device.rearm()
            read(device)
        finally:
            device.close()
        assert device.link.state is LinkState.CLOSED


def test_port_that_takes_nothing_or_is_closed_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(streams, "_WRITE_S", 0.05)
    other, end = os.openpty()
    stream = SerialStream(SerialSettings(port=os.ttyname(end), baud=115_200))
    with pytest.raises(DeviceError, match=r"takes no bytes for 0\.05 s"):
        stream.write(b"\x55" * 1_000_000)
    stream.close()
    with pytest.raises(DeviceError, match="gone while writing"):
        stream.write(b"\x55")
    os.close(end)
    os.close(other)
