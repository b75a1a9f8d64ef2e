"""The flight recorder: what it holds, when it writes, and that what it wrote is a whole MCAP file."""

import errno
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from forefeel.common import topics
from forefeel.common.bus import Bus
from forefeel.common.clock import VirtualClock
from forefeel.common.codec import encode
from forefeel.common.flight import CycleRow, Rings, Row
from forefeel.common.messages import Grip, SafetyState
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.state.flight_writer import FlightWriter
from forefeel.common.transport.memory import MemoryBus
from tests.messages import usual
from tests.stepped import SteppedWorker
from tests.unit.failing import refusing
from tests.unit.recording_samples import force

MS = 1_000_000
S = 1000 * MS
CYCLES = topics.CONTROL_CYCLE.key("cell", "insertion")
FORCES = topics.FORCE.key("cell", "insertion")
STOPS = topics.EMERGENCY_STOP.key("cell", "insertion")


def row(stamp_ns: int, force_n: float = 0.5) -> Row:
    state, grip = SafetyState.ARMED, Grip.CLOSED
    return CycleRow(
        stamp_ns, 0.02, 0.001, True, 0.0199, 0.001, force_n, True, state, grip, stamp_ns // MS, 41
    )


def test_a_ring_holds_what_a_record_needs_and_no_more() -> None:
    ring = Rings().ring(CYCLES)
    for tick in range(100_000):
        ring.add(row(tick * MS))
    kept = ring.between(0, 100_000 * MS)
    assert 2500 < len(kept) < 4200
    now_ns = 99_999 * MS
    span = ring.between(now_ns - 2 * S, now_ns)
    assert [r[0] for r in span] == list(range(97_999 * MS, 100_000 * MS, MS))


def test_a_bus_keeps_every_payload_in_and_out_but_what_is_too_long_for_its_topic() -> None:
    clock, network, rings = VirtualClock(5), MemoryBus(), Rings()
    bus = Bus(network.session(clock), "cell", "insertion", clock, rings)
    put = network.session(clock).publisher(STOPS, topics.Qos.EVENT)
    heard: list[int] = []
    bus.subscribe(topics.EMERGENCY_STOP, lambda _, receive_ns: heard.append(receive_ns))
    sender = bus.publisher(topics.FORCE)
    put(stop := encode(usual(topics.EMERGENCY_STOP)))
    clock.set_ns(9)
    sender.send(sample := force(1))
    put(b"x" * 60_000)
    assert rings.ring(STOPS).between(0, 10) == [(5, stop)]
    assert rings.ring(FORCES).between(0, 10) == [(9, encode(sample))]
    assert heard == [5]
    assert bus.malformed == {topics.EMERGENCY_STOP.name: 1}, "what is not kept is delivered all the same"


def test_a_flood_on_one_topic_washes_out_no_other_and_is_bounded() -> None:
    rings = Rings()
    rings.ring(FORCES).add((1, b"kept"))
    for number in range(50_000):
        rings.ring(STOPS).add((number, b"x"))
    assert rings.ring(FORCES).between(0, 2) == [(1, b"kept")]
    assert len(rings.ring(STOPS).between(0, 50_000)) <= 256


class Recorder:
    """A flight recorder whose rings hold five seconds that end at `now_ns`."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir()
        self.folder, self.rings, self.clock = folder, Rings(), VirtualClock(10 * S)
        self.noted: list[tuple[str, dict[str, Any]]] = []
        self.writer = FlightWriter(folder, 3, self.rings, self.clock, self._note, SteppedWorker)
        self.writer.facts = {"role": "slave"}
        self.now_ns = self.clock.now_ns()
        for tick in range(-5000, 1):
            stamp_ns = self.now_ns + tick * MS
            self.rings.ring(CYCLES).add(row(stamp_ns))
            self.rings.ring(FORCES).add((stamp_ns, encode(force(6000 + tick))))

    def _note(self, event: str, now_ns: int, axis: str = "", **details: Any) -> None:  # noqa: ANN401
        del now_ns, axis
        self.noted.append((event, details))

    def files(self) -> list[Path]:
        return sorted(self.folder.iterdir())

    def noted_events(self) -> list[str]:
        return [event for event, _ in self.noted]


@pytest.fixture
def recorder(tmp_path: Path) -> Iterator[Recorder]:
    recorder = Recorder(tmp_path / "flight")
    yield recorder
    recorder.writer.close()


def test_a_record_has_the_two_seconds_before_and_what_came_after(recorder: Recorder) -> None:
    recorder.writer.ask("insertion", "watchdog", "no valid command", recorder.now_ns)
    for tick in range(1, 700):
        recorder.rings.ring(CYCLES).add(row(recorder.now_ns + tick * MS))
    recorder.rings.ring(FORCES).add((recorder.now_ns + MS, b"no message"))
    recorder.rings.ring(CYCLES).add(row(recorder.now_ns + 2 * MS, float("nan")))
    recorder.clock.set_ns(recorder.now_ns + S // 2)
    recorder.writer.write(closing=False)
    (path,) = recorder.files()
    assert path.stat().st_mode & 0o777 == 0o600
    run = Run(path)
    assert not run.truncated
    stamps = run.column("insertion", topics.CONTROL_CYCLE, "stamp_ns")
    assert (stamps[0], stamps[-1]) == (recorder.now_ns - 2 * S, recorder.now_ns + S // 2)
    assert len(stamps) == 2501
    assert run.count("insertion", topics.FORCE) == 2001
    assert run.metadata["flight"]["event"] == "watchdog" and run.metadata["flight"]["role"] == "slave"
    assert recorder.noted[-1][1]["malformed"] == 2  # the payload that is none, and the cycle without a number
    with path.open("rb") as file:  # another reader of the format
        topics_found = {channel.topic for _, channel, _ in make_reader(file).iter_messages()}
    assert topics_found == {CYCLES, FORCES}


def test_one_a_second_at_most_and_the_newest_are_kept(recorder: Recorder) -> None:
    for second in range(5):
        for _ in range(3):
            recorder.writer.ask("insertion", "estop", "again", recorder.now_ns + second * S)
    recorder.writer.close()
    assert recorder.noted_events().count("flight_record") == 5
    names = [details["file"] for event, details in recorder.noted if event == "flight_record"]
    assert [path.name for path in recorder.files()] == sorted(names)[-3:]


@pytest.mark.parametrize(
    ("place", "error"),
    [
        ("recording.mcap_writer.os.fsync", OSError(errno.ENOSPC, "No space left on device")),
        ("state.flight_writer.RunWriter", ValueError("no such number")),
    ],
)
def test_a_record_that_fails_leaves_no_half_is_said_and_costs_no_other(
    recorder: Recorder, monkeypatch: pytest.MonkeyPatch, place: str, error: Exception
) -> None:
    recorder.writer.ask("insertion", "watchdog", "x", recorder.now_ns)
    recorder.clock.set_ns(recorder.now_ns + S)
    with monkeypatch.context() as broken:
        broken.setattr(f"forefeel.common.{place}", refusing(error))
        recorder.writer.write(closing=False)
    assert str(error.args[-1]) in recorder.noted[0][1]["what"]
    assert recorder.files() == []
    recorder.writer.ask("insertion", "fault", "x", recorder.now_ns + S)
    recorder.writer.close()
    assert recorder.noted_events() == ["flight_failed", "flight_record"]


def test_half_written_record_goes_at_start(tmp_path: Path) -> None:
    (tmp_path / ".x.mcap.part").write_bytes(b"half")
    FlightWriter(tmp_path, 3, Rings(), VirtualClock(0), lambda *_: None)
    assert list(tmp_path.iterdir()) == []
