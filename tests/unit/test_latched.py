"""While an emergency stop or a fault is latched nothing moves the stage, whichever way it is tried; only a
local clearing ends it, and that says what it did.
"""

from collections.abc import Callable
from typing import Any

import pytest

from forefeel.common import topics
from forefeel.common.codec import encode
from forefeel.common.errors import DeviceError
from forefeel.common.messages import EmergencyStop, LimitEvent, SafetyEvent, SafetyState
from forefeel.slave.clearing import Clearing
from tests.unit.slave_cell import Book, Cell
from tests.unit.slave_rig import MS, START_M, SlaveRig

S = 1000 * MS


def stop(rig: SlaveRig) -> None:
    rig.stop()


def fault(rig: SlaveRig) -> None:
    rig.load_cell.error = DeviceError("load cell: silent")
    rig.step()
    rig.load_cell.error = None


def latch_file(rig: SlaveRig) -> None:
    assert isinstance(rig.event_sink, Book)
    rig.event_sink.broken = "latch: No space left on device"


LATCHES: list[tuple[Callable[[SlaveRig], None], SafetyState]] = [
    (stop, SafetyState.ESTOPPED),
    (fault, SafetyState.FAULT),
    (latch_file, SafetyState.FAULT),
]


def commands(rig: SlaveRig) -> None:
    rig.position_m += 0.0005
    rig.fields["velocity_m_s"] = 0.05
    rig.step(300)


def press_again(rig: SlaveRig) -> None:
    for held in (False, True, False, True):
        rig.deadman = held
        rig.step(40)


def new_session(rig: SlaveRig) -> None:
    rig.sends = rig.beating = False
    rig.step(1300)
    rig.session_id += 1
    rig.sends = rig.beating = True
    rig.shake()
    rig.step(300)
    press_again(rig)


def garbage(rig: SlaveRig) -> None:
    """Whatever a network may say: no topic clears."""
    for topic in topics.TOPICS:
        put = rig.put_anything(topic)
        for payload in (b"", b"\xc1", b"clear"):
            put(payload)
    said: list[Any] = [
        SafetyEvent(
            session_id=rig.session_id, sequence=1, stamp_ns=rig.now_ns,
            before=SafetyState.ESTOPPED, event="clear", after=SafetyState.IDLE, reason="",
        ),
        LimitEvent(
            session_id=rig.session_id, sequence=1, stamp_ns=rig.now_ns,
            rule="clear", requested=0, applied=0, unit="", count=1,
        ),
    ]  # fmt: skip
    for topic, message in zip((topics.SAFETY_EVENT, topics.LIMIT_EVENT), said, strict=True):
        rig.put_anything(topic)(encode(message))
    rig.step(50)


def device_comes_back(rig: SlaveRig) -> None:
    rig.load_cell.error = DeviceError("load cell: unplugged")
    rig.step(20)
    rig.load_cell.error = None
    rig.step(50)
    press_again(rig)


def shut_down(rig: SlaveRig) -> None:
    rig.axis.shutdown = True
    rig.step(20)
    rig.axis.shutdown = False
    press_again(rig)


def pushed(rig: SlaveRig) -> None:
    """A hand on the stage: it is not driven back."""
    rig.stage.position_m += 0.002
    press_again(rig)


@pytest.mark.parametrize(
    "path", [commands, press_again, new_session, garbage, device_comes_back, shut_down, pushed]
)
@pytest.mark.parametrize(("latch", "state"), LATCHES, ids=["estop", "fault", "latch file"])
def test_nothing_moves_while_it_is_latched(
    latch: Callable[[SlaveRig], None], state: SafetyState, path: Callable[[SlaveRig], None]
) -> None:
    rig = SlaveRig(event_sink=Book()).armed()
    latch(rig)
    rig.step(150)
    assert rig.state() is state
    rig.stage.commands.clear()
    path(rig)
    assert rig.stage.commands == []
    assert rig.state() in {state, SafetyState.ESTOPPED if path is garbage else state}


def test_a_flood_of_stops_is_coalesced_and_the_first_stops_at_once() -> None:
    book = Book()
    rig = SlaveRig(event_sink=book).armed()
    for number in range(5000):
        rig.stop("nurse", f"press {number}")
    rig.step()
    assert rig.state() is SafetyState.ESTOPPED
    for _ in range(1000):
        rig.stop()
        rig.step()
    assert [e["after"] for e in book.of("safety")].count("estopped") == 1
    asked = book.of("emergency_stop")
    assert 1 <= len(asked) <= 3
    assert sum(int(str(e["count"])) for e in asked) >= 5000
    assert (asked[0]["by"], asked[0]["reason"]) == ("nurse", "press 0")


def test_a_stop_is_no_duplicate_whatever_its_sequence_session_and_stamp() -> None:
    rig = SlaveRig().armed()
    same = EmergencyStop(session_id=0, sequence=1, stamp_ns=-5, source="nurse", reason="r")
    for _ in range(2):  # the very same bytes stop again after a clearing
        rig.put_raw(topics.EMERGENCY_STOP, encode(same))
        rig.step(2)
        assert rig.state() is SafetyState.ESTOPPED
        rig.axis.clear()
        rig.step(2)
        assert rig.state() in (SafetyState.IDLE, SafetyState.READY)


def test_after_a_clearing_a_deadman_that_is_held_moves_nothing() -> None:
    rig = SlaveRig().armed()
    rig.stop()
    rig.step(150)
    rig.axis.clear()
    rig.step(200)
    assert rig.state() is SafetyState.READY
    rig.deadman = False
    rig.step(2)
    rig.position_m, rig.deadman = rig.stage.position_m, True
    rig.step(300)
    assert rig.state() is SafetyState.ARMED


def test_refusals_and_transitions_are_logged() -> None:
    book = Book()
    rig = SlaveRig(event_sink=book).armed()
    session, rig.session_id = rig.session_id, 99  # a second writer
    rig.step(500)
    rig.session_id = session
    rig.put_raw(topics.COMMAND, b"\xc1")
    assert not rig.shake(7).accepted
    rig.step(2500)
    refused = [e for e in book.of("refused") if e["name"] == "session"]
    assert 1 <= len(refused) <= 3
    assert sum(int(str(e["count"])) for e in refused) == 500
    assert [e["name"] for e in book.of("malformed")] == ["master/command"]
    assert "another session holds the lease" in str(book.of("session_refused")[0]["reason"])
    assert book.of("session_opened")[0]["session"] == session
    events = [e["event"] for e in book.of("safety")]
    assert events[:4] == ["session_opened", "engage", "engaged", "watchdog"]
    assert book.flights == [("insertion", "watchdog")]
    rig.beating = False
    rig.step(1500)
    assert book.of("session_lost")[0]["session"] == session


def test_a_device_that_stays_broken_does_not_fill_the_log() -> None:
    book = Book()
    rig = SlaveRig(event_sink=book).armed()
    rig.stage.broken = {"read"}
    rig.step(3000)
    faults = book.of("device_fault")
    assert [(e["name"], e["reason"]) for e in faults] == [("stage", "stage: read refused")]
    assert len(book.of("safety")) < 8


# --- clearing, of the daemon ---

STOPPED, IDLE = SafetyState.ESTOPPED, SafetyState.IDLE


def test_a_stop_of_one_axis_stops_both_and_one_clearing_clears_both() -> None:
    cell = Cell()
    cell.daemon.axes[0].emergency_stop("pressed", "nurse")
    cell.step()
    assert cell.states() == [STOPPED, STOPPED]
    assert cell.clear() == [
        Clearing("insertion", "estopped: pressed", ""),
        Clearing("rotation", "estopped: axis insertion is halted", ""),
    ]
    cell.step()
    assert cell.states() == [IDLE, IDLE]


def test_one_axis_that_is_named_takes_with_it_what_stopped_for_it_and_nothing_else() -> None:
    cell = Cell()
    cell.daemon.axes[0].emergency_stop("pressed")
    cell.step()
    assert [each.axis for each in cell.clear("rotation")] == ["rotation"]
    cell.step()
    assert cell.states() == [STOPPED, STOPPED]  # the other one is still halted
    assert [each.axis for each in cell.clear("insertion")] == ["insertion", "rotation"]
    cell.step()
    assert cell.states() == [IDLE, IDLE]


def test_a_cause_that_persists_is_named_and_stays_latched() -> None:
    cell = Cell()
    cell.book.broken = "latch: No space left on device"
    cell.step()
    assert cell.states()[0] is SafetyState.FAULT
    (first, *_) = cell.clear()
    assert first.still == "latch: No space left on device"
    assert cell.states()[0] is SafetyState.FAULT


def test_a_stop_that_was_latched_when_the_daemon_ended_is_latched_when_it_starts() -> None:
    rig_book = Book()
    rig_book.latched = {"insertion": "nurse: pressed"}
    rig = SlaveRig(event_sink=rig_book)
    rig.axis.open(rig.now_ns)
    rig.shake()
    rig.step(200)
    assert rig.state() is SafetyState.ESTOPPED
    assert rig.states[-1].reason == "latched before the slave was started: nurse: pressed"
    assert rig.stage.position_m == START_M and rig.stage.commands == []
    rig.axis.clear()
    rig.step(2)
    assert rig.state() in (SafetyState.IDLE, SafetyState.READY)
