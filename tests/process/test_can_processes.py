"""slcan over pseudo terminals between processes: hub here, host and device each in its own."""

import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO, NamedTuple

import can
import pytest

from forefeel.common.errors import DeviceError
from forefeel.common.hardware.link import LinkState
from forefeel.devices.canopen.bus import open_bus
from forefeel.devices.canopen.hub import CanHub
from forefeel.devices.canopen.settings import CanSettings
from forefeel.devices.cia402.driver import Cia402Stage
from forefeel.devices.cia402.protocol import DriveState
from forefeel.devices.cia404.driver import Cia404LoadCell
from forefeel.devices.emulation.wire import Faults
from tests.devices.can_rig import (
    START_M,
    cell_on,
    cell_settings,
    drive_on,
    running,
    stage_settings,
)
from tests.process.can_host import HEARTBEAT_S
from tests.waiting import PATIENCE_S, wait_until
from tests.witness import Witness, as_other_work

pytestmark = pytest.mark.usefixtures("ahead_of_other_work")
MAX_VELOCITY_M_S, QUICK_STOP_M_S2 = 0.2, 20.0
STALL_S = 0.05  # of a busy machine
CALM_S = 1.0  # a silence that it does not reach
PATIENT_TRIES = 12  # of 0.3 s each: a busy machine answers within 3.6 s


class Seen(NamedTuple):
    """A line of the device process."""

    t_s: float
    state: str
    position_m: float


@contextmanager
def process(module: str, link: Path) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", f"tests.process.{module}", str(link)]
    with as_other_work():
        child = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        yield child
    finally:
        child.kill()
        child.wait()
        if child.stdout is not None:
            child.stdout.close()


def listen(stream: IO[str], seen: list[Seen]) -> None:
    for line in stream:
        t_s, state, position_m = line.split()
        seen.append(Seen(float(t_s), state, float(position_m)))


def test_a_killed_host_leaves_the_drive_at_rest(tmp_path: Path, witness: Witness) -> None:
    links = [tmp_path / "host", tmp_path / "device"]
    hub, seen = CanHub(links), list[Seen]()
    with running(hub), process("can_devices", links[1]) as device:
        assert device.stdout is not None
        listener = threading.Thread(target=listen, args=(device.stdout, seen))
        listener.start()
        wait_until(lambda: seen)
        with process("can_host", links[0]) as host:
            assert host.stdout is not None
            assert host.stdout.readline() == "moving\n"
            count = len(seen)
            wait_until(lambda: len(seen) > count + 100)
            host.kill()
            killed_s = time.monotonic()
            host.wait()
        rest_s = killed_s + 3 * HEARTBEAT_S + MAX_VELOCITY_M_S / QUICK_STOP_M_S2 + STALL_S
        wait_until(lambda: seen[-1].t_s > rest_s + 0.5)
        device.kill()
        listener.join()
    hub.close()
    before = [each for each in seen[count:] if each.t_s < killed_s]
    assert max(b.position_m for b in before) - min(b.position_m for b in before) > 0.005
    after = [each for each in seen if each.t_s > rest_s]
    assert (after[-1].position_m, after[-1].state) == (after[-2].position_m, "QUICK_STOP")
    with witness.timely(STALL_S):
        assert len(after) > 20
        assert {each.position_m for each in after} == {after[0].position_m}
        assert {each.state for each in after} == {"QUICK_STOP"}


def test_python_cans_own_adapter_driver_and_ours_understand_each_other(tmp_path: Path) -> None:
    links = [tmp_path / "ours", tmp_path / "theirs"]
    hub = CanHub(links, bitrate=500_000, faults=Faults())
    with running(hub):
        ours = open_bus(CanSettings(interface="slcan", channel=str(links[0]), bitrate=500_000))
        theirs = can.Bus(interface="slcan", channel=str(links[1]), bitrate=500_000, sleep_after_open=0)
        wait_until(lambda: all(port.adapter.open for port in hub._ports))
        frames = [
            can.Message(arbitration_id=0x123, data=bytes(range(i % 9)), is_extended_id=False)
            for i in range(50)
        ]
        frames.append(can.Message(arbitration_id=0x1ABCDEF0, data=b"\x01", is_extended_id=True))
        for sender, receiver in ((ours, theirs), (theirs, ours)):
            for frame in frames:
                sender.send(frame)
            found = [receiver.recv(PATIENCE_S) for _ in frames]
            assert [(f.arbitration_id, f.data, f.is_extended_id) for f in found if f] == [
                (f.arbitration_id, f.data, f.is_extended_id) for f in frames
            ]
        ours.shutdown()
        theirs.shutdown()
    hub.close()
    assert hub.load > 0.0


@pytest.mark.parametrize("faults", ["corrupt=0.02,drop=0.01"])
@pytest.mark.soak
def test_bad_lines_are_counted_and_the_others_arrive(tmp_path: Path, faults: str) -> None:
    links = [tmp_path / "host", tmp_path / "device"]
    hub = CanHub(links, faults=Faults.parse(faults), seed=3)
    with running(hub):
        host, device = (open_bus(CanSettings(interface="slcan", channel=str(link))) for link in links)
        wait_until(lambda: all(port.adapter.open for port in hub._ports))
        sent, found = 2000, 0
        for i in range(sent):
            device.send(can.Message(arbitration_id=i % 0x400, data=bytes(8), is_extended_id=False))
            while (message := host.recv(0.0)) is not None:
                found += len(message.data) == 8
        while host.recv(0.2) is not None:
            found += 1
        counts = hub.counts()
        host.shutdown()
        device.shutdown()
    hub.close()
    lost = sent - found
    assert 0 < lost <= counts["to_host_dropped"] + 2 * counts["to_host_corrupted"]
    assert lost >= counts["to_host_dropped"]


def test_a_cable_that_is_pulled_and_plugged_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # a busy machine is silent for longer than a drive may be
    monkeypatch.setattr("forefeel.devices.cia402.driver.SILENT_S", CALM_S)
    monkeypatch.setattr("forefeel.devices.cia404.driver._SILENT_S", CALM_S)
    monkeypatch.setattr("forefeel.devices.canopen.sdo._TRIES", PATIENT_TRIES)
    links = [tmp_path / name for name in ("host", "drive", "cell")]
    buses = [CanSettings(interface="slcan", channel=str(link)) for link in links]
    hub = CanHub(links)
    with running(hub) as between_steps:
        drive, transducer = drive_on(open_bus(buses[1])), cell_on(open_bus(buses[2]))
        stage, cell = (
            Cia402Stage(stage_settings(buses[0], heartbeat_s=CALM_S / 3)),
            Cia404LoadCell(cell_settings(buses[0])),
        )
        links_of = (stage.link, cell.link)
        with running(drive, transducer), ExitStack() as left:  # no thread of theirs meets the next test
            left.callback(cell.close)
            left.callback(stage.close)
            stage.open()
            cell.open()
            between_steps(lambda: hub.provoke("unplug"))
            wait_until(lambda: all(link.inhibited for link in links_of))
            assert "gone" in str(stage.link.inhibited)
            wait_until(lambda: drive.model.state is DriveState.QUICK_STOP)
            between_steps(lambda: hub.provoke("plug"))
            wait_until(lambda: all(link.state is LinkState.CONFIGURED for link in links_of))
            with pytest.raises(DeviceError, match="gone"):
                stage.command(0.02, 0.0, time.monotonic_ns())
            stage.rearm()
            cell.rearm()
            wait_until(lambda: drive.model.state is DriveState.ENABLED)
            wait_until(lambda: len(cell.read(time.monotonic_ns(), None)) > 0)
            assert drive.model.position_m == pytest.approx(START_M, abs=1e-5)
        drive.close()
        transducer.close()
    hub.close()
