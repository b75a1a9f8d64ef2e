"""What Prometheus gets of a cell."""

import socket
from typing import Any

import pytest

pytest.importorskip("prometheus_client")

from forefeel.common.clock import VirtualClock
from forefeel.common.codec import encode, encode_batch
from forefeel.common.errors import EndpointError
from forefeel.common.messages import SafetyState
from forefeel.common.topics import FORCE, MASTER_STATE, SLAVE_STATE, SLAVE_TIMING, Topic
from forefeel.metrics import CellMetrics, serve
from tests.messages import usual

S = 1_000_000_000


def heard(
    topic: Topic[Any],
    axis: str = "insertion",
    cell: CellMetrics | None = None,
    **changes: Any,  # noqa: ANN401
) -> CellMetrics:
    cell = cell or CellMetrics(VirtualClock(6 * S))
    cell.hear(topic.key("cathlab", axis), encode(usual(topic, **changes)), 5 * S)
    return cell


Values = dict[tuple[str, frozenset[tuple[str, str]]], float]


def values(cell: CellMetrics) -> Values:
    """By name and labels; those of the axis insertion are without it."""
    samples = [sample for family in cell.collect() for sample in family.samples]
    return {
        (each.name, frozenset(each.labels.items()) - {("axis", "insertion")}): each.value for each in samples
    }


def at(found: Values, family: str, /, **labels: str) -> float:
    return found[family, frozenset(labels.items())]


def test_the_newest_state_is_told_with_its_age() -> None:
    cell = heard(SLAVE_STATE, state=SafetyState.READY)
    heard(SLAVE_STATE, cell=cell, stops=3, position_m=0.02, clock_offset_ns=-2_000_000)
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
    cell = heard(SLAVE_STATE)
    heard(SLAVE_STATE, "rotation", cell, position_m=0.5)
    heard(MASTER_STATE, cell=cell)
    found = values(cell)
    assert at(found, "forefeel_position_metres", axis="rotation") == 0.5
    assert at(found, "forefeel_deadman") == 1.0
    assert at(found, "forefeel_counter_total", role="master", name="forces_reordered") == 2
    assert ("forefeel_clock_offset_seconds", frozenset({("role", "master")})) not in found
    names = [family.name for family in cell.collect()]
    assert len(names) == len(set(names)), "one family for each name"


def test_a_loop_is_a_histogram_in_seconds() -> None:
    timing: dict[str, Any] = {
        "loop": "control",
        "ticks": 10,
        "missed": 1,
        "edges_us": (50.0, 100.0),
        "counts": (8, 1, 1),
    }
    found, labels = values(heard(SLAVE_TIMING, **timing, max_us=95.0)), {"role": "slave", "loop": "control"}
    buckets = {"5e-05": 8, "0.0001": 9, "+Inf": 10}
    for edge, count in buckets.items():
        assert at(found, "forefeel_loop_lateness_seconds_bucket", le=edge, **labels) == count
    assert at(found, "forefeel_loop_lateness_seconds_sum", **labels) == pytest.approx(275e-6)
    assert at(found, "forefeel_loop_lateness_seconds_count", **labels) == 10
    assert at(found, "forefeel_loop_missed_total", **labels) == 1
    for edges_us, counts in ((50.0,), ()), ((), (1, 2)):  # lengths that do not fit
        unfit = values(heard(SLAVE_TIMING, **timing | {"edges_us": edges_us, "counts": counts}))
        assert at(unfit, "forefeel_loop_missed_total", **labels) == 1
        assert not any("lateness" in name for name, _ in unfit)


def test_what_a_stranger_says_stays_bounded() -> None:
    cell = CellMetrics(VirtualClock(6 * S))
    for number in range(200):
        cell.hear(FORCE.key("cathlab", f"axis{number}"), b"", 0)
    cell.hear("elsewhere/a/b/c", b"", 0)
    cell.hear(SLAVE_STATE.key("cathlab", "axis0"), b"\xff", 0)
    found = values(cell)
    assert len({dict(labels)["axis"] for name, labels in found if name == "forefeel_messages_total"}) == 32
    assert at(found, "forefeel_malformed_total") == 1


def test_busy_port_is_one_line() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(EndpointError, match=f"--port {port}"):
            serve(CellMetrics(VirtualClock(6 * S)), "127.0.0.1", port)
