"""The manufacturer's own library drives the emulated stage; native units, no online database."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

import pytest

from forefeel.devices.zaber.emulator import ZaberDevice, ZaberModel
from tests.emulators.threads import on_pty

MODEL = ZaberModel(homed=False, start_m=0.003, limits_m=(0.0, 0.02))


@pytest.fixture(scope="module")
def zaber() -> ModuleType:
    pytest.importorskip("zaber_motion", reason="zaber-motion is not installed (extra `peers`)")
    import zaber_motion.ascii
    import zaber_motion.events

    zaber_motion.events.event_executor.submit(lambda: None).result()  # its thread for events stays
    module: ModuleType = zaber_motion.ascii
    return module


@contextmanager
def connected(zaber: ModuleType, device: ZaberDevice, folder: Path) -> Iterator[object]:
    with on_pty(device, folder) as port, zaber.Connection.open_serial_port(port.path, direct=True) as peer:
        yield peer


def test_it_homes_moves_stops_and_reads_back(zaber: ModuleType, tmp_path: Path) -> None:
    device = ZaberDevice(MODEL)
    with connected(zaber, device, tmp_path) as peer:
        axis = peer.get_device(1).get_axis(1)  # type: ignore[attr-defined]
        assert not axis.is_homed() and axis.warnings.get_flags() == {"WR"}
        axis.home()
        assert axis.is_homed() and axis.get_position() == 0
        axis.move_absolute(20_000)
        assert axis.get_position() == 20_000 and device.motion()[0] == pytest.approx(2e-3)
        axis.move_max(wait_until_idle=False)
        assert axis.is_busy()
        axis.stop()
        assert not axis.is_busy() and 20_000 < axis.get_position() < 200_000
        axis.move_min()
        assert axis.get_position() == 0
        axis.settings.set("maxspeed", 123_456)
        assert axis.settings.get("maxspeed") == 123_456
    assert device.counts["ignored"] == 0


def test_it_understands_rejections_checksums_and_faults(zaber: ModuleType, tmp_path: Path) -> None:
    from zaber_motion.exceptions import (
        BadCommandException,
        BadDataException,
        DriverDisabledException,
        MovementFailedException,
    )

    device = ZaberDevice(MODEL)
    with connected(zaber, device, tmp_path) as peer:
        axis = peer.get_device(1).get_axis(1)  # type: ignore[attr-defined]
        peer.generic_command("set comm.checksum 1", device=1)  # type: ignore[attr-defined]
        found = peer.generic_command("get system.serial", device=1)  # type: ignore[attr-defined]
        assert (found.data, found.status, found.warning_flag) == ("73451", "IDLE", "WR")
        with pytest.raises(BadCommandException):
            peer.generic_command("bogus", device=1, axis=1)  # type: ignore[attr-defined]
        with pytest.raises(BadDataException):
            axis.move_absolute(10**8)
        device.provoke("stuck")
        with pytest.raises(MovementFailedException, match="Stalled and Stopped"):
            axis.move_absolute(1000)
        device.provoke("free")
        axis.warnings.clear_flags()
        device.provoke("drive_fault")
        with pytest.raises(DriverDisabledException):
            axis.move_absolute(1000)
        axis.driver_enable()
        axis.move_absolute(1000)
        assert axis.get_position() == 1000
