"""python-can's own slcan driver against ours, over two ends of an emulated bus."""

from pathlib import Path

import can

from forefeel.devices.canopen.bus import open_bus
from forefeel.devices.canopen.hub import CanHub
from forefeel.devices.shared.settings import CanSettings
from tests.emulators.threads import running
from tests.waiting import PATIENCE_S, wait_until


def test_slcan_frames_pass_both_ways_between_python_can_and_ours(tmp_path: Path) -> None:
    links = [tmp_path / "ours", tmp_path / "theirs"]
    hub = CanHub(links, bitrate=500_000)
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
