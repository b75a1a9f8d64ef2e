"""How many connections a daemon opens where nothing is said, and the keys of numbered ones."""

import pytest

from forefeel.common.topics import (
    COMMAND,
    EMERGENCY_STOP,
    LIMIT_EVENT,
    PUBLISHED,
    SAFETY_EVENT,
    numbered,
    parse_key,
)
from forefeel.common.transport.settings import MOST_CONNECTIONS, TransportSettings

FAR, NEAR = "tls/192.0.2.7:7447", "tls/127.0.0.1:7447"


@pytest.mark.parametrize(
    ("listen", "connect", "asked", "count"),
    [
        ((), (FAR,), None, MOST_CONNECTIONS),
        ((), ("tcp/192.0.2.7:7447",), None, MOST_CONNECTIONS),
        ((), (NEAR, FAR), None, MOST_CONNECTIONS),
        ((), (FAR,), 4, 4),
        ((), (NEAR,), 4, 4),
        ((), (NEAR,), None, 1),
        ((), ("udp/192.0.2.7:7447",), None, 1),
        ((), ("quic/192.0.2.7:7447",), None, 1),
        (("tls/0.0.0.0:7447",), (), None, 1),
        (("tls/0.0.0.0:7447",), (), 8, 1),
    ],
)
def test_only_who_connects_to_another_host_over_tcp_has_several(
    listen: tuple[str, ...], connect: tuple[str, ...], asked: int | None, count: int
) -> None:
    settings = TransportSettings(listen=listen, connect=connect, connections=asked)
    assert settings.parallel_connections == count


@pytest.mark.parametrize("count", [0, MOST_CONNECTIONS + 1])
def test_no_other_number_is_taken(count: int) -> None:
    with pytest.raises(ValueError, match="connections"):
        TransportSettings(connect=(FAR,), connections=count)


def test_a_longest_pause_below_the_first_one_is_refused() -> None:
    with pytest.raises(ValueError, match=r"retry_max_s = 0.05: expected at least retry_min_s = 0.1"):
        TransportSettings(retry_max_s=0.05)


def test_events_that_are_needed_in_order_take_no_turns() -> None:
    assert {topic for topic in PUBLISHED if topic.crosses and not topic.takes_turns} == {
        LIMIT_EVENT,
        SAFETY_EVENT,
    }
    assert COMMAND.takes_turns and EMERGENCY_STOP.takes_turns


def test_a_numbered_key_is_none_of_a_cell() -> None:
    key = numbered(3, COMMAND.key("cell", "insertion"))
    assert key == "connection/3/forefeel/cell/insertion/master/command"
    assert parse_key(key) is None
