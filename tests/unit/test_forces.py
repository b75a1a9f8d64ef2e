"""One force message per reading, each with what the stage did when it was made."""

import pytest

from forefeel.common import topics
from forefeel.common.bus import Bus
from forefeel.common.clock import VirtualClock
from forefeel.common.messages import ForceSample, Grip, MotionCommand, SafetyState
from forefeel.common.transport.memory import MemoryBus
from forefeel.slave.forces import ForcePublisher, Instant
from forefeel.slave.load_cell import LoadCellReading
from forefeel.slave.stage import StageReading
from tests.unit.slave_rig import MS, SlaveRig


def command(sequence: int) -> MotionCommand:
    return MotionCommand(
        session_id=1,
        sequence=sequence,
        stamp_ns=sequence * MS,
        position_m=0.0,
        velocity_m_s=0.0,
        deadman=True,
    )


def answered(*stamps_ns: int | None) -> list[ForceSample]:
    """Ten ticks at 1 mm/s that execute a command each; then these readings."""
    clock, heard = VirtualClock(), list[ForceSample]()
    network = MemoryBus()
    bus = Bus(network.session(clock), "cell", "insertion", clock)
    listener = Bus(network.session(clock), "cell", "insertion", clock)
    listener.subscribe(topics.FORCE, lambda sample, _: heard.append(sample))
    answers = ForcePublisher(bus.publisher(topics.FORCE))
    for tick in range(1, 11):
        answers.note(Instant(tick * MS, StageReading(tick * 1e-6, 1e-3), command(tick), Grip.CLOSED))
    for number, stamp_ns in enumerate(stamps_ns):
        answers.send(LoadCellReading(0.1 * number, number, True, stamp_ns), 1, None)
    return heard


def test_a_reading_without_a_stamp_belongs_to_the_newest_tick() -> None:
    (sample,) = answered(None)
    assert (sample.stamp_ns, sample.answers_sequence) == (10 * MS, 10)
    assert sample.position_m == pytest.approx(10e-6, abs=1e-12)


def test_readings_of_a_batch_find_their_own_ticks() -> None:
    samples = answered(3 * MS, 3 * MS + MS // 4, 7 * MS)
    assert [s.answers_sequence for s in samples] == [3, 4, 7]
    assert [s.stamp_ns for s in samples] == [3 * MS, 3 * MS + MS // 4, 7 * MS]
    assert [s.position_m for s in samples] == pytest.approx([3e-6, 3.25e-6, 7e-6], abs=1e-12)
    assert [s.raw_counts for s in samples] == [0, 1, 2]


def test_a_reading_from_before_all_that_is_remembered_belongs_to_the_oldest() -> None:
    (sample,) = answered(7)
    assert (sample.stamp_ns, sample.answers_sequence, sample.position_m) == (7, 1, 1e-6)


def test_a_slow_cell_gives_as_many_messages_as_readings_and_its_newest_counts_until_it_is_stale() -> None:
    rig = SlaveRig().armed()
    rig.load_cell.every = 8
    before = len(rig.forces)
    rig.step(80)
    assert len(rig.forces) - before == 10
    assert rig.state() is SafetyState.ARMED
    rig.load_cell.every = 1_000_000
    rig.step(1000)  # silent: stale after 20 ms, a fault after gate.force_timeout_s
    assert rig.state() is SafetyState.FAULT


def test_a_device_that_failed_is_rearmed_by_the_clearing_and_by_nothing_else() -> None:
    rig = SlaveRig().armed()
    rig.stage.broken = {"read", "rearm"}
    rig.step(50)
    rig.axis.clear()
    rig.step(50)
    assert rig.state() is SafetyState.FAULT
    rig.stage.broken = set()
    rig.step(50)
    assert rig.state() is SafetyState.FAULT
    rig.axis.clear()
    rig.step(50)
    assert rig.state() is not SafetyState.FAULT
