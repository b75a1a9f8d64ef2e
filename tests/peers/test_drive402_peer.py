"""canopen's own CiA 402 client, which shares nothing with our driver, drives our drive."""

import time
from collections.abc import Iterator

import canopen
import pytest
from canopen.profiles.p402 import BaseNode402
from canopen.sdo.client import SdoClient

from forefeel.devices.canopen.emulator import object_dictionary
from forefeel.devices.cia402.emulator import Drive402, HomingPhase, contents
from forefeel.devices.cia402.protocol import DriveState
from tests.devices.can_rig import (
    COUNTS_PER_M,
    DRIVE,
    START_M,
    drive_on,
    new_channel,
    virtual_bus,
)
from tests.emulators.threads import running
from tests.waiting import wait_until

SYNC_S = 0.02


@pytest.fixture(autouse=True)
def _patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """The client gives up after 0.2 to 0.8 s, which a busy machine may take."""
    for name in ("SWITCH_OP_MODE", "SWITCH_STATE_FINAL", "SWITCH_STATE_SINGLE", "CHECK_TPDO"):
        monkeypatch.setattr(BaseNode402, f"TIMEOUT_{name}", 60.0)
    monkeypatch.setattr(SdoClient, "RESPONSE_TIMEOUT", 60.0)


@pytest.fixture
def pair() -> Iterator[tuple[Drive402, BaseNode402]]:
    """A drive that lives, and a client that has mapped its PDOs and is not enabled yet."""
    bus = new_channel()
    drive = drive_on(virtual_bus(bus))
    network = canopen.Network(virtual_bus(bus))
    network.NOTIFIER_CYCLE = 0.02
    with running(drive):
        network.connect()
        try:
            node = BaseNode402(DRIVE, object_dictionary(contents(DRIVE)))
            network.add_node(node)
            _map(node)
            network.sync.start(SYNC_S)
            yield drive, node
        finally:
            network.sync.stop()
            network.disconnect()
    drive.close()


def _map(node: BaseNode402) -> None:
    node.nmt.state = "PRE-OPERATIONAL"
    node.sdo[0x60C2][1].raw = 20
    node.tpdo[1].cob_id, node.tpdo[1].trans_type, node.tpdo[1].enabled = 0x180 + DRIVE, 1, True
    for index in (0x6041, 0x6061, 0x6064):
        node.tpdo[1].add_variable(index)
    node.rpdo[1].cob_id, node.rpdo[1].trans_type, node.rpdo[1].enabled = 0x200 + DRIVE, 255, True
    for index in (0x6040, 0x607A):
        node.rpdo[1].add_variable(index)
    node.tpdo[1].save()
    node.rpdo[1].save()
    node.setup_402_state_machine()
    node.nmt.state = "OPERATIONAL"


def enable(node: BaseNode402) -> None:
    node.op_mode = "CYCLIC SYNCHRONOUS POSITION"
    node.rpdo[1][0x607A].raw = node.sdo[0x6064].raw
    node.state = "OPERATION ENABLED"


def test_it_enables_and_moves_the_drive(pair: tuple[Drive402, BaseNode402]) -> None:
    drive, node = pair
    assert node.sdo[0x6502].raw == 0xA0  # cyclic synchronous position, homing
    enable(node)
    assert node.state == "OPERATION ENABLED"
    assert node.op_mode == "CYCLIC SYNCHRONOUS POSITION"
    assert drive.model.position_m == pytest.approx(START_M, abs=1e-6)
    for i in range(1, 11):
        node.rpdo[1][0x607A].raw = round((START_M + 0.0005 * i) * COUNTS_PER_M)
        node.rpdo[1].transmit()
        time.sleep(SYNC_S)
    wait_until(lambda: abs(drive.model.position_m - 0.015) < 1e-5)
    wait_until(lambda: abs(node.tpdo_values[0x6064] - 15_000) <= 10)


def test_quick_stop_and_back(pair: tuple[Drive402, BaseNode402]) -> None:
    drive, node = pair
    node.sdo[0x605A].raw = 6
    enable(node)
    node.state = "QUICK STOP ACTIVE"
    assert drive.model.state.name == "QUICK_STOP"
    node.state = "OPERATION ENABLED"
    assert drive.model.state.name == "ENABLED"


def test_a_fault_is_shown_told_and_reset(pair: tuple[Drive402, BaseNode402]) -> None:
    drive, node = pair
    enable(node)
    drive.provoke("drive_fault")
    wait_until(lambda: node.state == "FAULT")
    assert [error.code for error in node.emcy.log] == [0x2310]
    assert node.sdo[0x603F].raw == 0x2310
    node.reset_from_fault()  # which enables by itself: why it is no part of the product
    assert drive.model.state is DriveState.ENABLED


def test_it_refuses_what_it_does_not_have(pair: tuple[Drive402, BaseNode402]) -> None:
    _, node = pair
    with pytest.raises(canopen.SdoAbortedError, match="0x06020000"):
        node.sdo.upload(0x6072, 0)
    with pytest.raises(canopen.SdoAbortedError, match="0x06070010"):
        node.sdo.download(0x6060, 0, bytes(4))


@pytest.mark.parametrize(("method", "edge_m"), [(17, -0.0045), (18, 0.0255), (37, START_M)])
def test_it_homes_the_drive(pair: tuple[Drive402, BaseNode402], method: int, edge_m: float) -> None:
    drive, node = pair
    drive.model.homing.switches_m = -0.0045, 0.0255
    node.sdo[0x607C].raw = 777
    node.sdo[0x6098].raw = method
    node.sdo[0x6099][1].raw, node.sdo[0x6099][2].raw, node.sdo[0x609A].raw = 100_000, 2_000, 20_000_000
    assert node.homing(timeout=10)
    wait_until(lambda: drive.model.homing.phase is HomingPhase.ATTAINED)  # at rest, too
    found = node.sdo[0x6064].raw
    assert drive.model.position_m - edge_m == pytest.approx(
        (found - 777) / COUNTS_PER_M, abs=3.1e-6
    )  # a step, a count
    assert drive.model.position_m == pytest.approx(edge_m, abs=1e-5)
    assert node.is_homed()


def test_a_homing_without_its_switch_is_an_error(pair: tuple[Drive402, BaseNode402]) -> None:
    drive, node = pair
    drive.model.homing.switches_m = -1.0, 1.0
    node.sdo[0x6098].raw = 17
    node.sdo[0x6099][1].raw, node.sdo[0x6099][2].raw, node.sdo[0x609A].raw = 100_000, 2_000, 20_000_000
    assert not node.homing(timeout=10)
    assert node.statusword & 0x3000 == 0x2000


def test_a_method_that_it_has_not_is_refused(pair: tuple[Drive402, BaseNode402]) -> None:
    _, node = pair
    with pytest.raises(canopen.SdoAbortedError, match="0x06090030"):
        node.sdo[0x6098].raw = 5
