"""What ROS nodes get of a cell, and what becomes of what they send."""

import socket
import sys
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from forefeel.common.clock import VirtualClock
from forefeel.common.codec import encode, encode_batch
from forefeel.common.messages import Message, SafetyState
from forefeel.common.topics import FORCE, HAPTICS, SLAVE_STATE, Topic
from forefeel.common.transport.memory import MemoryBus
from forefeel.devices.servo.driver import POSITION
from forefeel.estop.network import Stopper
from forefeel.ros import cdr
from forefeel.ros.bridge import Commands, Node, ReaderWatch, RosOptions
from forefeel.ros.crtk import RosFeed, Send, Take, ros_name
from tests.messages import haptics, usual
from tests.network import Traffic
from tests.unit.test_ros_cdr import decoded, servo, string_stamped

MS, S = 1_000_000, 1_000_000_000
EPOCH_NS = 1_764_000_000 * S
RATE_HZ = 200.0


class Wire:
    """A wire that keeps what is sent: (bytes, stamp) by topic."""

    name, notice, silence = "wire", "", "nobody reads"

    def __init__(self) -> None:
        self.sent: defaultdict[str, list[tuple[bytes, int]]] = defaultdict(list)
        self.kinds: dict[str, cdr.RosType] = {}
        self.takes: dict[str, Take] = {}
        self.number, self.news = 0, list[str]()

    def publisher(self, topic: str, kind: cdr.RosType) -> Send:
        self.kinds[topic] = kind
        return lambda payload, stamp_ns: self.sent[topic].append((payload, stamp_ns))

    def subscribe(self, topic: str, kind: cdr.RosType, take: Take) -> None:
        self.takes[topic] = take

    def readers(self) -> int:
        return self.number

    def remarks(self) -> list[str]:
        news, self.news = self.news, []
        return news

    def close(self) -> None: ...

    def read(self, topic: str) -> list[dict[str, Any]]:
        return [decoded(payload, self.kinds[topic]) for payload, _ in self.sent[topic]]


def feed_of(wire: Wire, rate_hz: float = RATE_HZ) -> RosFeed:
    return RosFeed("cathlab", rate_hz, lambda stamp_ns: EPOCH_NS + stamp_ns, wire.publisher)


def hear(feed: RosFeed, topic: Topic[Any], messages: Iterable[Message], receive_ns: int = S) -> None:
    payloads = [encode(message) for message in messages]
    payload = encode_batch(payloads) if topic.batched else payloads[0]
    feed.hear(topic.key("cathlab", "insertion"), payload, receive_ns)


def forces(first: int, number: int = 20, **changes: Any) -> list[Message]:  # noqa: ANN401 - any field
    return [
        usual(FORCE, sequence=i + 1, stamp_ns=i * MS, position_m=i * 1e-4, **changes)
        for i in range(first, first + number)
    ]


@pytest.mark.parametrize(("rate_hz", "step"), [(200.0, 5), (1000.0, 1), (300.0, 3), (50.0, 20)])
def test_each_so_many_messages_go_on_with_the_stamp_of_their_tick_whatever_the_batches_hold(
    rate_hz: float, step: int
) -> None:
    wire = Wire()
    feed, sent = feed_of(wire, rate_hz), 0
    for number in (20, 21, 19, 1, 3, 2, 21, 13):
        hear(feed, FORCE, forces(sent, number), S + (sent + number - 1) * MS)
        sent += number
    expected = range(0, 100, step)
    stamps = [stamp_ns for _, stamp_ns in wire.sent["/cathlab/insertion/measured_js"]]
    assert stamps == [EPOCH_NS + S + i * MS for i in expected]
    positions = [joint["position"][0] for joint in wire.read("/cathlab/insertion/measured_js")]
    assert positions == pytest.approx([i * 1e-4 for i in expected])


@pytest.mark.parametrize(
    ("state", "expected"),
    [
        (SafetyState.IDLE, ("DISABLED", True, False)),
        (SafetyState.ARMED, ("ENABLED", True, True)),
        (SafetyState.READY, ("ENABLED", True, False)),
        (SafetyState.STOPPING, ("ENABLED", True, True)),
        (SafetyState.ESTOPPED, ("PAUSED", True, False)),
        (SafetyState.FAULT, ("FAULT", False, False)),
    ],
)
def test_a_safety_state_is_one_of_crtk(state: SafetyState, expected: tuple[str, bool, bool]) -> None:
    wire = Wire()
    hear(feed_of(wire), SLAVE_STATE, [usual(SLAVE_STATE, state=state)])
    (sent,) = wire.read("/cathlab/insertion/operating_state")
    assert (sent["state"], sent["is_homed"], sent["is_busy"]) == expected


@pytest.mark.parametrize(
    ("changes", "age_ns", "level"),
    [
        ({}, 0, 0),
        ({"over_limit": True}, 0, 1),
        ({"near_load": "holding"}, 0, 1),
        ({"state": SafetyState.ESTOPPED, "over_limit": True}, 0, 2),
        ({"state": SafetyState.FAULT}, 501 * MS, 3),
    ],
)
def test_diagnostics_say_the_worst(changes: dict[str, Any], age_ns: int, level: int) -> None:
    feed = feed_of(Wire())
    hear(feed, SLAVE_STATE, [usual(SLAVE_STATE, caveats=("no hardware: stage",), **changes)])
    (status,) = decoded(feed.diagnostics(S + age_ns), cdr.DIAGNOSTIC_ARRAY)["status"]
    assert (status["level"], status["name"], status["message"]) == (
        level, "forefeel: cathlab/insertion", "ramp done",
    )  # fmt: skip
    values = {pair["key"]: pair["value"] for pair in status["values"]}
    assert values["refused_late"] == "7" and values["caveats"] == "no hardware: stage"


def test_names_are_what_ros_allows_and_axes_are_bounded() -> None:
    assert ros_name("lab.2", "3rd-axis", "measured_js") == "/lab_2/_3rd_axis/measured_js"
    wire = Wire()
    feed = feed_of(wire)
    for number in range(100):
        feed.hear(SLAVE_STATE.key("cathlab", f"axis{number}"), encode(usual(SLAVE_STATE)), S)
    feed.hear(FORCE.key("cathlab", "axis0"), b"\xff", S)
    feed.hear("elsewhere/a/b/c", b"", S)
    assert len(feed.axes) == 32 and not wire.sent["/cathlab/axis0/measured_js"]


def test_wire_that_nobody_reads_is_named_at_5_s_and_each_minute(capsys: pytest.CaptureFixture[str]) -> None:
    wire = Wire()
    readers = ReaderWatch([wire], 0)
    for second in range(121):
        wire.number = int(70 <= second < 80)
        wire.news = ["too much asked"] if second == 75 else []
        readers.report(second * S)
    lines = capsys.readouterr().err.splitlines()
    assert lines == [*["ros: nobody reads"] * 2, "ros: too much asked", "ros: nobody reads"]  # at 5, 65, 84 s


def test_the_topics_of_an_axis_are_those_of_crtk_and_what_is_not_known_is_not_sent() -> None:
    wire = Wire()
    feed = feed_of(wire)
    hear(feed, FORCE, forces(0, 1, setpoint_m=0.012, force_n=0.4, velocity_m_s=0.02))
    hear(feed, HAPTICS, [haptics(1, 0, predicted_n=0.7, low_n=None, high_n=None)])
    hear(feed, SLAVE_STATE, [usual(SLAVE_STATE)])
    at = "/cathlab/insertion/"
    (measured,), (setpoint,) = wire.read(f"{at}measured_js"), wire.read(f"{at}setpoint_js")
    assert (measured["name"], measured["velocity"][0]) == (["insertion"], 0.02)
    assert (setpoint["position"][0], len(setpoint["velocity"])) == (0.012, 0)
    (force,), (predicted,) = wire.read(f"{at}body/measured_cf"), wire.read(f"{at}body/predicted_cf")
    assert (force["wrench"]["force"]["z"], predicted["wrench"]["force"]["z"]) == (0.4, 0.7)
    assert force["header"]["frame_id"] == "cathlab/insertion"
    wire.sent.clear()
    feed = feed_of(wire)
    hear(feed, FORCE, forces(0, 1, valid=False))
    hear(feed, HAPTICS, [haptics(1, 0, predicted_n=None, low_n=None, high_n=None)])
    assert {topic for topic, sent in wire.sent.items() if sent} == {f"{at}measured_js"}


class Rig:
    """Commands of a viewer of the cell `cathlab`, and what it puts on the bus."""

    def __init__(self, servo: dict[str, Path], *states: SafetyState) -> None:
        self.clock = VirtualClock(S)
        bus = MemoryBus()
        self.traffic = Traffic(bus.session(self.clock))
        self.stopper = Stopper(bus.session(self.clock), "cathlab", (), "ros", "", listens=False)
        self.commands = Commands(self.stopper, servo, self.clock)
        for state in states:
            self.state(state)

    def state(self, state: SafetyState) -> None:
        payload = encode(usual(SLAVE_STATE, state=state))
        self.stopper.hear(SLAVE_STATE.key("cathlab", "insertion"), payload, self.clock.now_ns())

    def stops(self, first: int = 0, last: int = 1) -> int:
        """Stops that were sent until then, at ticks of 20 ms."""
        for tick in range(first, last):
            self.commands.repeat_stop(S + tick * 20 * MS)
        return sum(key.endswith("any/estop") for key, _, _ in self.traffic.payloads)

    def node(self, wire: Wire, accepts: bool) -> Node:
        options = RosOptions(0, RATE_HZ, True, accept_commands=accepts, servo=self.commands._servo)
        return Node([wire], "cathlab", options, self.stopper, self.clock)


def test_a_pause_is_the_emergency_stop_until_it_is_confirmed(capsys: pytest.CaptureFixture[str]) -> None:
    rig = Rig({}, SafetyState.ARMED)
    assert rig.stops() == 0
    rig.commands.state_command("insertion", string_stamped("pause"), b"")
    assert rig.stops(0, 5) == 5
    rig.clock.set_ns(S + MS)
    rig.state(SafetyState.ESTOPPED)
    assert rig.stops(5, 10) == 6
    assert "pause" in rig.stopper.reason and "insertion" in rig.stopper.reason
    assert "stopped: insertion estopped" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("states", "stops", "says"),
    [([SafetyState.ARMED], 101, "armed"), ([SafetyState.ESTOPPED], 101, "silent"), ([], 0, "no slave")],
)
def test_a_pause_that_nobody_confirms_is_told_after_2_s(
    states: list[SafetyState], stops: int, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = Rig({}, *states)
    rig.commands.state_command("insertion", string_stamped("pause"), b"")
    assert rig.stops(0, 200) == stops
    _, line = capsys.readouterr().err.splitlines()
    assert "NOT CONFIRMED" in line and says in line


def test_a_pause_while_the_last_one_ends_is_not_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig({}, SafetyState.ARMED)
    rig.commands.state_command("insertion", string_stamped("pause"), b"")

    def pause_again(_text: str) -> None:
        rig.clock.set_ns(3 * S)
        rig.commands.state_command("insertion", string_stamped("pause"), b"")

    monkeypatch.setattr("forefeel.ros.bridge.ask", pause_again)
    assert rig.stops(0, 101) == 101
    assert rig.stops(101, 111) == 111


@pytest.mark.parametrize("command", ["resume", "enable", "home", "", "Pause"])
def test_every_other_state_command_is_refused(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    rig = Rig({}, SafetyState.ARMED)
    for _ in range(20):
        rig.commands.state_command("insertion", string_stamped(command), b"")
    assert rig.stops() == 0
    lines = capsys.readouterr().err.splitlines()
    assert [line.partition(" refused ")[2].partition(":")[0] for line in lines] == ["(1)", "(10)"]


def test_a_servo_position_reaches_the_handle_of_its_axis_from_one_node_at_a_time(tmp_path: Path) -> None:
    path = tmp_path / "servo.sock"
    rig = Rig({"insertion": path})
    rig.commands.servo_jp("insertion", servo([], [0.1], [], []), b"first")  # nobody there yet
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as handle:
        handle.bind(str(path))
        rig.commands.servo_jp("insertion", servo([], [0.2], [0.3], []), b"first")
        rig.commands.servo_jp("insertion", servo([], [0.5], [], []), b"second")
        rig.commands.servo_jp("insertion", b"", b"first")
        rig.clock.set_ns(2 * S)
        rig.commands.servo_jp("insertion", servo([], [0.4], [], []), b"second")
        taken = [POSITION.unpack(handle.recv(64)) for _ in range(2)]
        with pytest.raises(BlockingIOError):
            handle.recv(64)
    assert taken == [(S, 0.2, 0.3), (2 * S, 0.4, 0.0)]


@pytest.mark.parametrize(
    ("accepts", "servo", "topics"),
    [
        (False, {}, set()),
        (True, {}, {"/cathlab/insertion/state_command"}),
        (True, {"insertion": Path("s")}, {"/cathlab/insertion/state_command", "/cathlab/insertion/servo_jp"}),
        (True, {"rotation": Path("s")}, {"/cathlab/insertion/state_command"}),
    ],
)
def test_commands_are_taken_where_asked_for(accepts: bool, servo: dict[str, Path], topics: set[str]) -> None:
    wire = Wire()
    node = Rig(servo).node(wire, accepts)
    for _ in range(2):
        node.hear(SLAVE_STATE.key("cathlab", "insertion"), encode(usual(SLAVE_STATE)), S)
    assert wire.takes.keys() == topics
    node.look(S)
    assert len(wire.sent["/diagnostics"]) == node.sent["/diagnostics"] == 1


def test_servo_without_axis_or_handle_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    node = Rig(dict.fromkeys(("insertion", "rotation"), tmp_path / "none")).node(Wire(), True)
    node.look(7 * S)  # before anything of the cell is heard
    node.hear(SLAVE_STATE.key("cathlab", "insertion"), encode(usual(SLAVE_STATE)), S)
    capsys.readouterr()
    for at_s in (2, 7, 8):
        node.look(at_s * S)
    insertion, rotation = (line for line in capsys.readouterr().err.splitlines() if "expected" in line)
    assert f"insertion: no handle at {tmp_path / 'none'}" in insertion and "rotation" in rotation


def test_dds_counts_readers_and_names_topics_that_are_asked_for_more(monkeypatch: pytest.MonkeyPatch) -> None:
    made, payloads = list[tuple[object, ...]](), list[bytes]()
    publisher = SimpleNamespace(subscriber_count=0, send_payload=payloads.append, close=None)
    topics = [SimpleNamespace(name="/a/b/c", subscribers=0), SimpleNamespace(name="/other", subscribers=9)]

    def advertise(*asked: str, depth: int) -> SimpleNamespace:
        made.append((*asked, depth))
        return publisher

    node = SimpleNamespace(advertise=advertise, graph=lambda: SimpleNamespace(topics=topics))
    monkeypatch.setitem(sys.modules, "rosless", SimpleNamespace(Node=lambda domain: node))
    monkeypatch.delitem(sys.modules, "forefeel.ros.dds_wire", raising=False)
    wire = import_module("forefeel.ros.dds_wire").DdsWire(7)
    del sys.modules["forefeel.ros.dds_wire"]
    wire.publisher("/a/b/c", cdr.JOINT_STATE)(b"cdr", 1)
    assert (made, payloads) == ([("/a/b/c", "sensor_msgs/msg/JointState", 100)], [b"cdr"])
    assert (wire.readers(), wire.remarks()) == (0, []) and "ROS_DOMAIN_ID=7" in wire.silence
    topics[0].subscribers, publisher.subscriber_count = 2, 1
    assert wire.readers() == 1
    (remark,) = wire.remarks()
    assert "/a/b/c" in remark and wire.remarks() == []


def test_without_the_extra_one_line_says_how_to_install_it(
    monkeypatch: pytest.MonkeyPatch, run: Callable[[Sequence[str]], int], capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "rosless", None)
    assert run(["ros", "--connect", "tcp/127.0.0.1:9"]) == 2
    assert capsys.readouterr().err == "forefeel: needs an extra: pip install 'forefeel[ros]'\n"
