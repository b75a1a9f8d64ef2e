"""What an axis and a cell know after they have heard so much."""

import numpy as np
import pytest

from forefeel.common import topics
from forefeel.common.codec import encode
from forefeel.common.events.text import CONTACT_LOST, OVER_LIMIT
from forefeel.common.messages import ForceSample, Grip
from forefeel.dashboard.axis_view import AxisView
from forefeel.dashboard.cell_view import BEYOND, MOST_AXES, CellView
from forefeel.dashboard.event_log import MOST
from tests.messages import force, haptics, usual, wave_n
from tests.unit.dashboard.talk import AHEAD_NS, AXIS, CELL, HOSTILE, MS, S, talk, viewed


def test_a_measured_force_stands_at_the_command_that_it_answers() -> None:
    """300 ms late and 40 s off by its own clock, it lies on what was predicted for that command."""
    view, _ = viewed(3.0)
    points = view.traces["measured"].since(0).rows
    start_ns = 9 * S + MS  # the first stamp that was heard
    assert len(points) > 200
    for t_s, force_n in points:
        assert force_n == pytest.approx(wave_n(start_ns + round(t_s * 1e9)), abs=1e-9)
    predicted = view.traces["predicted"].since(0).rows
    assert predicted[-1][0] - points[-1][0] == pytest.approx(0.3, abs=0.03)
    assert np.allclose(predicted[:, 1] - predicted[:, 2], 0.02)  # the band goes with it
    assert np.allclose(predicted[:, 3] - predicted[:, 1], 0.03)


def test_a_force_that_answers_nothing_stands_where_it_was_heard() -> None:
    view = AxisView()
    view.take(topics.HAPTICS, haptics(1, 9 * S), 9 * S)
    for tick in range(100):
        stamp_ns = 9 * S + tick * MS
        view.take(topics.FORCE, force(tick, stamp_ns + AHEAD_NS, None, force_n=0.7), stamp_ns + 5 * MS)
    points = view.traces["measured"].since(0).rows
    assert points[0][0] == pytest.approx(0.005, abs=0.02)
    assert set(points[:, 1]) == {0.7}


def test_an_answer_to_a_command_far_away_can_not_stretch_the_time() -> None:
    view = AxisView()
    view.take(topics.HAPTICS, haptics(1, 9 * S), 9 * S)
    for tick, stamp_ns in enumerate((2**62, 1, 9 * S + 100 * S)):
        view.take(topics.FORCE, force(tick, tick, (1, stamp_ns)), 10 * S + 40 * tick * MS)
    assert np.nanmax(view.traces["readback"].since(0).rows[:, 0]) < 2.0


def test_shape_stands_at_the_command_that_the_force_of_then_answers() -> None:
    view, now_ns = viewed(3.0)
    shape = usual(topics.SHAPE)
    view.take(topics.SHAPE, shape, now_ns)
    ((at_s, points),) = view.shapes.since(0)
    assert points == [(0.0, 0.0), (10.0, 0.0), (20.0, 3.0)]
    assert at_s == pytest.approx(view.timeline.now_s(now_ns) - 0.3, abs=0.01)
    alone = AxisView()
    alone.take(topics.SHAPE, shape, 9 * S)
    assert alone.shapes.since(0) == [(0.0, points)]


def test_stage_that_moves_with_open_fixture_moves_no_tip() -> None:
    view = AxisView()
    view.take(topics.HAPTICS, haptics(1, 9 * S), 9 * S)
    for tick, position_m in enumerate((0.03, 0.01, 0.02, 0.02)):
        grip = Grip.OPEN if tick == 0 else Grip.CLOSED
        said = force(tick, tick, None, position_m=position_m, gripper=grip)
        view.take(topics.FORCE, said, 9 * S + 40 * tick * MS)
    rows = view.traces["readback"].since(0).rows
    assert (rows[:, 1] - rows[:, 2]).tolist() == pytest.approx([0.03, 0.03, 0.04])


def test_each_answered_command_gives_one_delay() -> None:
    view, _ = viewed(2.0)
    assert len(view.delays.rows()) == pytest.approx(1700, abs=2)
    again = AxisView()
    for tick in range(50):
        again.take(topics.HAPTICS, haptics(tick, 9 * S + tick * MS, answered_sequence=5), 9 * S + tick * MS)
    assert len(again.delays.rows()) == 1


def test_the_error_of_a_prediction_is_counted_by_command() -> None:
    view, _ = viewed(8.0)
    assert view.watch.signs.outside_share == 0.0
    wrong = CellView()
    for topic, message, when in talk(1, 8000):
        changed = message
        if isinstance(message, ForceSample):
            changed = message.model_copy(update={"force_n": message.force_n + 0.1})
        wrong.take(AXIS, topic, changed, when)
    assert wrong.axes[AXIS].watch.signs.outside_share == 1.0


def test_events_are_kept_in_words_and_bounded() -> None:
    view, _ = viewed(0.01)
    view.take(topics.FORCE, force(1, 1, None), 20 * S)
    for count in range(3 * MOST):
        view.events.hear(usual(topics.LIMIT_EVENT, count=count + 1), "slave", count)
    view.events.hear(usual(topics.SAFETY_EVENT, reason=HOSTILE + "\x1b[2J\n"), "slave", 1)
    lines = list(view.events)
    assert len(lines) == MOST
    assert lines[-1].text == f"armed -> stopping, watchdog: {HOSTILE}?[2J?"
    assert lines[-2].text == f"velocity limited: 200 mm/s in place of 300 mm/s, {3 * MOST} times"
    assert (lines[-1].level, lines[-2].level) == ("warn", "off")


def test_amber_is_what_asks_for_an_act() -> None:
    view = AxisView()
    for topic, changes in (
        (topics.LIMIT_EVENT, {"rule": "rendered_force"}),
        (topics.LIMIT_EVENT, {"rule": OVER_LIMIT}),
        (topics.LIMIT_EVENT, {"rule": CONTACT_LOST}),
        (topics.SAFETY_EVENT, {"event": "release", "after": "stopping"}),
        (topics.SLAVE_HANDSHAKE, {"accepted": False}),
        (topics.SLAVE_STATE, {}),
        (topics.SLAVE_STATE, {"stamp_ns": S // 2}),
        (topics.SLAVE_STATE, {"stamp_ns": 2 * S}),
    ):
        view.take(topic, usual(topic, **changes), S)
    assert [line.level for line in view.events] == ["off", "warn", "warn", "busy", "warn", "warn"]
    assert list(view.events)[-1].text == "slave was silent for 1.5 s"


def test_axes_of_strangers_are_bounded() -> None:
    cell = CellView()
    for number in range(3 * MOST_AXES):
        cell.hear(topics.SLAVE_STATE.key(CELL, f"axis{number}"), encode(usual(topics.SLAVE_STATE)), number)
    assert len(cell.axes) == MOST_AXES
    assert cell.refused == {BEYOND: 2 * MOST_AXES}


def test_what_is_no_message_is_counted_and_changes_nothing() -> None:
    cell = CellView()
    cell.hear(topics.FORCE.key(CELL, AXIS), b"nonsense", 1)
    cell.hear("some/other/key", b"", 2)
    assert (cell.refused, cell.heard_ns, dict(cell.axes)) == ({"malformed": 1}, None, {})
    cell.hear(topics.COMMAND.key(CELL, AXIS), b"not decoded", 3)
    assert (cell.refused, cell.heard_ns) == ({"malformed": 1}, 3)
