"""What is logged of stops and refusals, and what a clearing clears and says."""

import pytest

from forefeel.common import topics
from forefeel.common.codec import encode
from forefeel.common.errors import RunError
from forefeel.common.messages import SafetyState
from tests.messages import usual
from tests.unit.rigs import START_M, Book, Cell, SlaveRig


def test_no_topic_clears_a_stop() -> None:
    rig = SlaveRig().armed()
    rig.stop()
    rig.step(150)
    rig.stage.commands.clear()
    header = {"session_id": rig.session_id, "stamp_ns": rig.now_ns}
    clear = usual(topics.SAFETY_EVENT, **header, before="estopped", event="clear", after="idle")
    before = len(rig.traffic.payloads)
    for topic in topics.TOPICS:
        for payload in (b"", b"\xc1", b"clear", encode(clear)):
            rig.put(topic, payload)
    del rig.traffic.payloads[before:]
    rig.step(50)
    assert rig.state() is SafetyState.ESTOPPED
    assert rig.stage.commands == []


def test_a_flood_of_stops_is_coalesced_and_the_first_stops_at_once() -> None:
    book = Book()
    rig = SlaveRig(event_sink=book).armed()
    for number in range(5000):
        rig.stop(f"press {number}")
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


def test_a_stop_is_latched_whatever_fails_in_its_tick(monkeypatch: pytest.MonkeyPatch) -> None:
    book = Book()
    rig = SlaveRig(event_sink=book).armed()

    def broken(*_: object) -> None:
        raise RunError("session is closed")

    monkeypatch.setattr(rig.axis._forces, "send", broken)
    rig.stop()
    with pytest.raises(RunError):
        rig.step()
    assert book.of("safety")[-1]["after"] == "estopped"


def test_a_stop_of_a_stopped_axis_is_told_once_for_all_its_repetitions() -> None:
    rig = SlaveRig().armed()
    told = []
    for reason in ("kinked", "again", "once more"):
        for _ in range(8):
            rig.stop(reason)
            rig.step(250)
        rig.step(1000)
        told.append([line for line in rig.axis.events.notices.drain() if reason in line])
    assert [len(lines) for lines in told] == [1, 1, 1]
    assert "-> estopped" in told[0][0] and "stopped already" in told[1][0]


def test_refusals_and_transitions_are_logged() -> None:
    book = Book()
    rig = SlaveRig(event_sink=book).armed()
    session, rig.session_id = rig.session_id, 99  # a second writer
    rig.step(500)
    rig.session_id = session
    rig.put(topics.COMMAND, b"\xc1")
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
    assert rig.axis.halted  # before the first tick: whoever clears now clears it
    rig.shake()
    rig.step(200)
    assert rig.state() is SafetyState.ESTOPPED
    assert rig.reason == "latched before the slave was started: nurse: pressed"
    assert rig.stage.position_m == START_M and rig.stage.commands == []
    rig.axis.clear()
    rig.step(2)
    assert rig.state() in (SafetyState.IDLE, SafetyState.READY)
