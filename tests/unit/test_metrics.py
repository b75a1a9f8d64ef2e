"""What Prometheus gets of a cell."""

import socket

import pytest

pytest.importorskip("prometheus_client")

from forefeel.common.clock import VirtualClock
from forefeel.common.codec import encode, encode_batch
from forefeel.common.errors import EndpointError
from forefeel.common.messages import LoopTiming, MasterState, Message, SafetyState, SlaveState
from forefeel.common.topics import FORCE, MASTER_STATE, SLAVE_STATE, SLAVE_TIMING, Topic
from forefeel.metrics import CellMetrics, serve

HEAD = {"session_id": 1, "sequence": 1, "stamp_ns": 0}
S = 1_000_000_000
Found = dict[tuple[str, tuple[tuple[str, str], ...]], float]


def slave_state(**changes: object) -> SlaveState:
    return SlaveState.model_validate(HEAD | {
        "state": SafetyState.ARMED, "reason": "ramp done", "position_m": 0.02, "velocity_m_s": -0.01,
        "gripper": "closed", "stops": 3, "clock_offset_ns": -2_000_000, "clock_bound_ns": 500_000,
        "counters": {"refused_late": 7},
    } | changes)  # fmt: skip


def heard(cell: CellMetrics, topic: Topic[Message], message: Message, axis: str = "insertion") -> None:
    cell.hear(topic.key("cathlab", axis), encode(message), 5 * S)


def values(cell: CellMetrics) -> Found:
    return {
        (sample.name, tuple(sorted(sample.labels.items()))): sample.value
        for family in cell.collect()
        for sample in family.samples
    }


def at(found: Found, family: str, /, **labels: str) -> float:
    return found[family, tuple(sorted({"axis": "insertion", **labels}.items()))]


def test_the_newest_state_is_told_with_its_age() -> None:
    cell = CellMetrics(VirtualClock(6 * S))
    heard(cell, SLAVE_STATE, slave_state(state=SafetyState.READY))
    heard(cell, SLAVE_STATE, slave_state())
    cell.hear(FORCE.key("cathlab", "insertion"), encode_batch([b""] * 3), 5 * S)
    found = values(cell)
    assert at(found, "forefeel_safety_state", state="armed") == 1.0
    assert at(found, "forefeel_safety_state", state="ready") == 0.0
    assert at(found, "forefeel_stops_total") == 3
    assert at(found, "forefeel_position_metres") == 0.02
    assert at(found, "forefeel_counter_total", role="slave", name="refused_late") == 7
    assert at(found, "forefeel_clock_offset_seconds", role="slave") == -0.002
    assert at(found, "forefeel_state_age_seconds", topic="slave/state") == pytest.approx(1.0)
    assert at(found, "forefeel_messages_total", topic="slave/state") == 2
    assert at(found, "forefeel_messages_total", topic="slave/force") == 3


def test_each_axis_and_each_end_stands_for_itself() -> None:
    cell = CellMetrics(VirtualClock(6 * S))
    heard(cell, SLAVE_STATE, slave_state())
    heard(cell, SLAVE_STATE, slave_state(position_m=0.5), axis="rotation")
    heard(cell, MASTER_STATE, MasterState.model_validate(HEAD | {
        "indication": "ready", "reason": "", "deadman": True, "clutched_s": 0.0, "clock_offset_ns": None,
        "clock_bound_ns": None, "counters": {"forces": 9},
    }))  # fmt: skip
    found = values(cell)
    assert at(found, "forefeel_position_metres", axis="rotation") == 0.5
    assert at(found, "forefeel_deadman") == 1.0
    assert at(found, "forefeel_counter_total", role="master", name="forces") == 9
    assert ("forefeel_clock_offset_seconds", (("axis", "insertion"), ("role", "master"))) not in found
    names = [family.name for family in cell.collect()]
    assert len(names) == len(set(names)), "one family for each name"


def test_a_loop_is_a_histogram_in_seconds() -> None:
    cell = CellMetrics(VirtualClock(6 * S))
    heard(cell, SLAVE_TIMING, LoopTiming.model_validate(HEAD | {
        "loop": "control", "ticks": 10, "missed": 1, "p50_us": 20.0, "p99_us": 90.0, "max_us": 95.0,
        "edges_us": (50.0, 100.0), "counts": (8, 1, 1), "scheduling": "SCHED_FIFO 50",
    }))  # fmt: skip
    found, labels = values(cell), {"role": "slave", "loop": "control"}
    assert at(found, "forefeel_loop_lateness_seconds_bucket", le="5e-05", **labels) == 8
    assert at(found, "forefeel_loop_lateness_seconds_bucket", le="0.0001", **labels) == 9
    assert at(found, "forefeel_loop_lateness_seconds_sum", **labels) == pytest.approx(275e-6)
    assert at(found, "forefeel_loop_lateness_seconds_bucket", le="+Inf", **labels) == 10
    assert at(found, "forefeel_loop_lateness_seconds_count", **labels) == 10
    assert at(found, "forefeel_loop_missed_total", **labels) == 1


def test_what_a_stranger_says_stays_bounded() -> None:
    cell = CellMetrics(VirtualClock(6 * S))
    for number in range(200):
        cell.hear(FORCE.key("cathlab", f"axis{number}"), b"", 0)
    cell.hear("elsewhere/a/b/c", b"", 0)
    cell.hear(SLAVE_STATE.key("cathlab", "axis0"), b"\xff", 0)
    found = values(cell)
    assert len({dict(labels)["axis"] for name, labels in found if name == "forefeel_messages_total"}) == 32
    assert found["forefeel_malformed_total", ()] == 1


def test_busy_port_is_one_line() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(EndpointError, match=f"--port {port}"):
            serve(CellMetrics(VirtualClock(6 * S)), "127.0.0.1", port)
