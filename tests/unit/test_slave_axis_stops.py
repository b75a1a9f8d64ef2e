"""How the slave's axis stops."""

import pytest

from forefeel.common import topics
from forefeel.common.codec import encode
from forefeel.common.errors import DeviceError
from forefeel.common.messages import EmergencyStop, SafetyState
from tests.unit.slave_rig import SlaveRig

S = SafetyState


# --- stops ---


def test_an_emergency_stop_from_the_network_stops_in_the_next_tick_and_latches() -> None:
    rig = SlaveRig().armed()
    rig.stop("nurse", "the patient moved")
    rig.step()
    assert (rig.state(), rig.states[-1].reason) == (S.ESTOPPED, "nurse: the patient moved")
    assert rig.stage.holds[-1] == rig.now_ns
    moved = len(rig.stage.commands)
    rig.deadman = False
    rig.step(50)
    rig.deadman = True
    rig.step(200)
    assert rig.state() is S.ESTOPPED
    assert len(rig.stage.commands) == moved


def test_a_stop_that_can_not_be_read_is_a_stop() -> None:
    rig = SlaveRig().armed()
    rig.put_raw(topics.EMERGENCY_STOP, b"\x93")
    rig.step(20)
    assert rig.state() is S.ESTOPPED
    assert rig.counters()["malformed_any_estop"] == 1


def test_a_stop_is_no_command_it_needs_no_session_and_may_be_repeated() -> None:
    rig = SlaveRig()
    rig.axis.open(rig.now_ns)
    rig.sends = False
    payload = encode(EmergencyStop(session_id=0, sequence=0, stamp_ns=-5, source="x", reason=""))
    for _ in range(1000):
        rig.put_raw(topics.EMERGENCY_STOP, payload)
    rig.step(20)
    assert rig.state() is S.ESTOPPED
    assert [event.event for event in rig.events] == ["estop"]


def test_a_reason_of_the_longest_length_can_be_published() -> None:
    rig = SlaveRig().armed()
    rig.stop("s" * 64, "r" * 256)
    rig.step(20)
    assert rig.state() is S.ESTOPPED
    assert rig.events[-1].reason == ("s" * 64 + ": " + "r" * 256)[:256]


def test_only_a_local_clear_ends_it_and_arming_starts_from_the_beginning() -> None:
    rig = SlaveRig().armed()
    rig.stop()
    rig.step(5)
    rig.axis.clear()
    rig.step(100)
    assert rig.state() is S.READY  # the deadman is still held
    rig.deadman = False
    rig.step(2)
    rig.deadman = True
    rig.step(40)
    assert rig.state() is S.ARMED


def test_a_clear_before_the_loop_has_heeded_the_stop_does_not_swallow_it() -> None:
    rig = SlaveRig().armed()
    rig.stop()
    rig.axis.clear()
    rig.step()
    assert rig.state() is S.ESTOPPED


@pytest.mark.parametrize("halt", ["fault", "estop"])
def test_a_clear_swallows_no_stop_that_came_after_what_it_clears(halt: str) -> None:
    rig = SlaveRig().armed()
    if halt == "fault":
        rig.load_cell.error = DeviceError("load cell: unplugged")
        rig.step(2)
        rig.load_cell.error = None
        assert rig.state() is S.FAULT
    else:
        rig.stop()
        rig.step()
    rig.step(50)
    rig.stop("surgeon", "again")
    rig.axis.clear()
    rig.step(5)
    assert (rig.state(), rig.states[-1].reason) == (S.ESTOPPED, "surgeon: again")
    rig.axis.clear()
    rig.step(2)
    assert rig.state() is S.READY


def test_a_fault_that_lasts_outlives_its_clearing() -> None:
    rig = SlaveRig().armed()
    rig.load_cell.error = DeviceError("load cell: unplugged")
    rig.step(2)
    rig.axis.clear()
    rig.step()
    assert (rig.state(), rig.states[-1].reason) == (S.FAULT, "load cell: unplugged")


def test_a_clearing_of_nothing_clears_nothing_later() -> None:
    rig = SlaveRig().armed()
    rig.axis.clear()
    rig.step(2)
    rig.stop()
    rig.step(20)
    assert rig.state() is S.ESTOPPED


def test_a_stop_between_the_clear_and_the_next_tick_holds() -> None:
    rig = SlaveRig().armed()
    rig.stop()
    rig.step()
    rig.axis.clear()
    rig.stop("surgeon", "again")
    rig.step(5)
    assert (rig.state(), rig.states[-1].reason) == (S.ESTOPPED, "surgeon: again")


def test_shutting_down_comes_to_rest_and_arms_no_more() -> None:
    rig = SlaveRig().armed()
    rig.axis.shutdown = True
    rig.step(30)
    rig.deadman = False
    rig.step(5)
    rig.deadman = True
    rig.step(50)
    assert (rig.state(), rig.axis.at_rest) == (S.READY, True)
