"""One viewer is sent what it does not have, however slowly it asks."""

import json
from typing import Any

import pytest

from forefeel.common.topics import SAFETY_EVENT, SHAPE, SLAVE_STATE
from forefeel.dashboard.cell_view import CellView
from forefeel.dashboard.feed import Feed
from tests.messages import usual
from tests.unit.dashboard.talk import AXIS, HOSTILE, MS, S, receive, talk


def test_points_are_sent_once_and_none_is_left_out() -> None:
    cell, feed, got = CellView(), Feed(), list[list[float]]()
    for first in range(1, 3000, 33):
        now_ns = receive(cell, talk(first, first + 33))
        got += feed.answer(cell, AXIS, now_ns)["traces"]["felt"]
    whole = Feed().answer(cell, AXIS, now_ns)["traces"]["felt"]
    assert got == whole


def test_shapes_are_sent_once_and_no_more_than_are_kept() -> None:
    cell, feed = CellView(), Feed()
    now_ns = receive(cell, talk(1, 500))

    def sent(first: int, last: int) -> list[float]:
        """x in mm of the tips that are sent after shapes of those numbers were received."""
        for number in range(first, last):
            cell.take(AXIS, SHAPE, usual(SHAPE, x_m=(0.0, 1e-3 * number), y_m=(0.0, 0.0)), now_ns)
        return [points[-1][0] for _, points in feed.answer(cell, AXIS, now_ns)["traces"]["shape"]]

    assert (sent(0, 3), sent(3, 3), sent(3, 5)) == ([0.0, 1.0, 2.0], [], [3.0, 4.0])
    assert sent(5, 1000) == [float(number) for number in range(600, 1000)]


def test_cards_come_when_they_say_something_new_and_slow_ones_seldom() -> None:
    cell, feed, seen = CellView(), Feed(), list[str]()
    for first in range(1, 1001, 33):
        now_ns = receive(cell, talk(first, first + 33))
        seen += feed.answer(cell, AXIS, now_ns)["cards"]
    assert 8 <= seen.count("numbers") <= 11
    assert seen.count("model") <= 3
    assert feed.answer(cell, AXIS, now_ns + MS)["cards"] == {}


def test_another_axis_and_another_time_begin_anew() -> None:
    cell, feed = CellView(), Feed()
    receive(cell, talk(1, 500), "rotation")
    now_ns = receive(cell, talk(1, 500))
    assert feed.answer(cell, "rotation", now_ns)["anew"]
    assert not feed.answer(cell, "rotation", now_ns)["anew"]
    found = feed.answer(cell, AXIS, now_ns)
    assert (found["anew"], found["axis"], found["axes"]) == (True, AXIS, ["rotation", AXIS])
    for topic, message, heard_ns in talk(1, 60, start_ns=0):  # the master's host was started again
        cell.take(AXIS, topic, message, heard_ns + 60 * S)
    assert feed.answer(cell, AXIS, 61 * S)["anew"]


@pytest.mark.parametrize("wanted", [None, "no such axis", HOSTILE])
def test_an_axis_that_is_not_there_is_the_first_one(wanted: str | None) -> None:
    cell = CellView()
    now_ns = receive(cell, talk(1, 10))
    assert Feed().answer(cell, wanted, now_ns)["axis"] == AXIS
    assert Feed().answer(CellView(), wanted, now_ns)["axis"] is None


def test_answers_are_json_without_nan_and_keep_hostile_text_as_it_is() -> None:
    cell, feed = CellView(), Feed()
    now_ns = receive(cell, talk(1, 700))
    view = cell.axes[AXIS]
    view.newest.slave = usual(SLAVE_STATE, reason=HOSTILE)
    view.events.hear(usual(SAFETY_EVENT, reason=HOSTILE), "slave", now_ns)
    answer: dict[str, Any] = json.loads(json.dumps(feed.answer(cell, AXIS, now_ns), allow_nan=False))
    assert answer["cards"]["standing"][2]["more"].endswith(HOSTILE)
    assert answer["cards"]["events"][0]["text"].endswith(HOSTILE)
