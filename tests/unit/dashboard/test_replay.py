"""A recording is read a span at a time, and shows what a viewer saw who was there."""

import struct
from pathlib import Path

import pytest

from forefeel.common.codec import encode
from forefeel.common.errors import RecordingError
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.recording.mcap_spans import RunSpans
from forefeel.common.recording.mcap_writer import RunWriter
from forefeel.common.topics import COMMAND, FORCE, HAPTICS, SAFETY_EVENT, SLAVE_STATE
from forefeel.dashboard.feed import Feed
from forefeel.dashboard.sources import LEAD_S, ReplayClock
from tests.messages import usual
from tests.unit.dashboard.talk import AXIS, CELL, S, talk
from tests.unit.recording_samples import force as other_force
from tests.unit.recording_samples import put

START_NS = 9 * S


def write(path: Path, seconds: int = 8, axis: str = AXIS) -> Path:
    """A chunk for every second; in the sixth an event, and the first command."""
    with RunWriter(path) as writer:
        writer.add_metadata("run", {"seed": "3"})
        for second in range(seconds):
            for topic, message, heard_ns in talk(1000 * second, 1000 * second + 1000):
                writer.write(topic.key(CELL, axis), encode(message), heard_ns)
            if second == 5:
                writer.write(SAFETY_EVENT.key(CELL, axis), encode(usual(SAFETY_EVENT)), START_NS + 5 * S + 1)
                writer.write(COMMAND.key(CELL, axis), encode(usual(COMMAND)), START_NS + 5 * S + 2)
            writer.flush()
    return path


@pytest.fixture(scope="module")
def run_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("run") / "run.mcap")


def test_a_span_holds_what_the_run_holds_there(run_file: Path) -> None:
    spans, run = RunSpans(run_file), Run(run_file)
    assert (spans.cell, spans.axes) == (CELL, (AXIS,))
    start_ns, end_ns = START_NS + 2_345_000_000, START_NS + 4_777_000_000
    found = list(spans.between(start_ns, end_ns, [FORCE, SLAVE_STATE]))
    for topic in FORCE, SLAVE_STATE:
        log_ns = run.log_ns(AXIS, topic)
        inside = (log_ns >= start_ns) & (log_ns < end_ns)
        expected = [each for each, wanted in zip(run.messages(AXIS, topic), inside, strict=True) if wanted]
        assert [each.message for each in found if each.topic is topic] == expected
        assert [each.log_ns for each in found if each.topic is topic] == log_ns[inside].tolist()
    assert {each.topic.name for each in found} == {FORCE.name, SLAVE_STATE.name}


def test_memory_does_not_grow_with_the_file(run_file: Path) -> None:
    spans = RunSpans(run_file)
    for _ in spans.between(0, 2**63, [FORCE]):
        pass
    assert spans._messages.cache_info().currsize <= 4


def test_the_file_of_a_killed_writer_ends_with_its_last_whole_chunk(run_file: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    whole = run_file.read_bytes()
    cut.write_bytes(whole[: len(whole) * 6 // 10])
    spans = RunSpans(cut)
    assert spans.metadata == RunSpans(run_file).metadata == {"run": {"seed": "3"}}
    assert START_NS + 3 * S < spans.end_ns < START_NS + 6 * S
    assert len(list(spans.between(0, 2**63, [HAPTICS]))) == round((spans.end_ns - START_NS) * 1e-6) - 1


@pytest.mark.parametrize(
    ("content", "word"), [(b"", "empty"), (b"no MCAP at all", "MCAP"), (None, "no messages")]
)
def test_what_is_no_run_is_one_line(tmp_path: Path, content: bytes | None, word: str) -> None:
    path = tmp_path / "run.mcap"
    if content is None:
        RunWriter(path).close()
    else:
        path.write_bytes(content)
    with pytest.raises(RecordingError, match=word):
        RunSpans(path)
    path.unlink()
    with pytest.raises(RecordingError, match="No such file"):
        RunSpans(path)


def test_any_time_shows_what_was_known_then(run_file: Path) -> None:
    replay = ReplayClock(RunSpans(run_file))
    for at_s, events in ((6.0, 7), (2.0, 2), (4.5, 5)):
        replay.go_to(at_s, 20.0)
        view = replay.cell.axes[AXIS]
        assert view.newest.haptics is not None
        assert view.newest.haptics.stamp_ns == pytest.approx(START_NS + at_s * S, abs=3e6)
        assert len(list(view.events)) == events


def test_going_on_is_the_same_as_going_there(run_file: Path) -> None:
    spans = RunSpans(run_file)
    played, sought = ReplayClock(spans), ReplayClock(spans)
    for step in range(1, 101):
        now_ns = played.go_to(step * 0.05, 20.0)
    assert sought.go_to(5.0, 20.0) == now_ns
    assert Feed().answer(played.cell, AXIS, now_ns) == Feed().answer(sought.cell, AXIS, now_ns)


def test_a_damaged_place_of_a_chunk_is_one_line(run_file: Path, tmp_path: Path) -> None:
    place, damaged = RunSpans(run_file)._chunks[0].at, tmp_path / "damaged.mcap"
    content, summary = run_file.read_bytes(), struct.pack("<Q", place)
    assert summary in content
    damaged.write_bytes(content.replace(summary, b"\xff" * 8))
    with pytest.raises(RecordingError, match="damaged at byte"):
        list(RunSpans(damaged).between(0, 2**63, [FORCE]))


def test_after_a_damaged_stretch_nothing_is_taken_twice(run_file: Path, tmp_path: Path) -> None:
    damaged = tmp_path / "damaged.mcap"
    content = bytearray(run_file.read_bytes())
    content[len(content) // 2] ^= 1
    damaged.write_bytes(content)
    replay, whole = ReplayClock(RunSpans(damaged)), ReplayClock(RunSpans(run_file))
    replay.go_to(2.0, 1.0)
    with pytest.raises(RecordingError, match="damaged"):
        replay.go_to(5.0, 1.0)
    now_ns = replay.go_to(2.1, 1.0)
    assert whole.go_to(2.1, 1.0) == now_ns
    assert Feed().answer(replay.cell, AXIS, now_ns) == Feed().answer(whole.cell, AXIS, now_ns)


def test_the_end_and_beyond_it(run_file: Path) -> None:
    spans = RunSpans(run_file)
    replay = ReplayClock(spans)
    assert replay.go_to(1e6, 20.0) == spans.end_ns + 1
    first = replay.cell
    view = replay.cell.axes[AXIS]
    assert view.newest.haptics is not None
    assert view.newest.haptics.sequence == 7999
    assert replay.go_to(1e6, 20.0) == spans.end_ns + 1
    assert replay.cell is first


def test_a_jump_reads_no_more_than_what_is_shown_before_it(tmp_path: Path) -> None:
    with RunWriter(tmp_path / "long.mcap") as writer:
        for second in range(120):
            put(writer, other_force(1000 * second, position_m=0.05, force_n=0.1))
            writer.flush()
    spans = RunSpans(tmp_path / "long.mcap")
    replay = ReplayClock(spans)
    replay.go_to(100.0, 5.0)
    view = replay.cell.axes["insertion"]
    assert view.newest.force is not None
    assert len(view.traces["readback"].since(0).rows) <= 2 * LEAD_S + 2
