import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from forefeel.common.errors import ConfigurationError
from forefeel.common.topics import (
    BY_NAME,
    COMMAND,
    EMERGENCY_STOP,
    FORCE,
    RECORDED,
    TOPICS,
    Qos,
    checked_segment,
    parse_key,
)

SEGMENT = st.text(st.characters(codec="utf-8"), min_size=1, max_size=12).filter(
    lambda text: not text.startswith("@") and not any(c in "*$?#/" or c.isspace() for c in text)
)


def test_the_table_is_consistent() -> None:
    keys = [topic.key("cell", "axis") for topic in TOPICS]
    assert len(set(keys)) == len(keys) == len(BY_NAME)
    for topic in TOPICS:
        assert topic.name.split("/")[0] == topic.publisher
        if topic.stale_after_s is not None:
            assert topic.rate_hz is not None
            assert topic.stale_after_s > 2.0 / topic.rate_hz, "one lost message is no silence"
        assert (topic.qos is Qos.EVENT) == (topic.rate_hz is None)
    assert [topic for topic in TOPICS if topic.stale_after_s and topic.qos is Qos.STREAM] == [COMMAND, FORCE]


def test_what_safety_rests_on_is_recorded_and_never_dropped_when_congested() -> None:
    assert EMERGENCY_STOP in RECORDED
    assert EMERGENCY_STOP.qos is Qos.EVENT
    unrecorded = {topic.name for topic in TOPICS if not topic.recorded}
    assert unrecorded == {"master/heartbeat", "slave/heartbeat", "slave/cycle"}  # that is for flight records


@given(SEGMENT, SEGMENT)
def test_parsing_is_the_inverse_of_the_key(cell: str, axis: str) -> None:
    for topic in TOPICS:
        assert parse_key(topic.key(cell, axis)) == (cell, axis, topic)
    assert (checked_segment(cell, "cell"), checked_segment(axis, "axis")) == (cell, axis)


@pytest.mark.parametrize(
    "text",
    [
        "", "*", "**", "a*", "$*", "a$b", "what?", "a#b", "a/b", "/", "@admin", " ", "a b", "a\tb", "a\n",
        "\u00a0",
    ],
)  # fmt: skip
def test_a_segment_with_a_meaning_for_the_router_is_refused_everywhere(text: str) -> None:
    with pytest.raises(ConfigurationError, match=r"^cell = .*: expected one key segment") as caught:
        checked_segment(text, "cell")
    assert len(str(caught.value).splitlines()) == 1
    assert parse_key(COMMAND.key(text, "axis")) is None
    assert parse_key(COMMAND.key("cell", text)) is None


@given(st.text(max_size=60))
@example("forefeel/*/*/any/estop")
def test_what_parses_is_exactly_a_key_of_the_table(key: str) -> None:
    parsed = parse_key(key)
    if parsed is not None:
        cell, axis, topic = parsed
        assert topic.key(cell, axis) == key
        assert not set("*$?#") & set(key)
