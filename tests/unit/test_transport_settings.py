"""Settings of the transport and of its impairment."""

import pytest
from pydantic import ValidationError

from forefeel.common import topics
from forefeel.common.transport.settings import (
    MOST_CONNECTIONS,
    PRESETS,
    ImpairmentSettings,
    TransportSettings,
)


def test_a_mapping_overrides_its_preset() -> None:
    settings = ImpairmentSettings.model_validate({"preset": "paper", "loss": 0.05})
    assert settings == PRESETS["paper"].model_copy(update={"loss": 0.05})


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ("moon", "preset 'moon' is unknown, expected one of none, lan, wan"),
        ({"preset": 3}, "preset 3 is unknown"),
        ({"delay": 1}, "unknown key delay"),
        ({"preset": "none", "jitter_s": 0.01}, "jitter_s = 0.01: expected at most delay_s = 0"),
        ({"burst_loss": 0.9, "burst_length": 2}, "burst_loss = 0.9: expected at most 0.667"),
    ],
)
def test_bad_impairments_are_refused(data: object, message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        ImpairmentSettings.model_validate(data)


def test_a_client_connects_and_does_not_listen() -> None:
    with pytest.raises(ValidationError, match="at least one endpoint in connect"):
        TransportSettings(mode="client")
    with pytest.raises(ValidationError, match="none in listen"):
        TransportSettings(mode="client", connect=("tcp/a:1",), listen=("tcp/b:1",))


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


def test_events_that_are_needed_in_order_take_no_turns() -> None:
    ordered = {topic for topic in topics.PUBLISHED if topic.crosses and not topic.takes_turns}
    assert ordered == {topics.LIMIT_EVENT, topics.SAFETY_EVENT}
    assert topics.COMMAND.takes_turns and topics.EMERGENCY_STOP.takes_turns


def test_a_numbered_key_is_none_of_a_cell() -> None:
    key = topics.numbered(3, topics.COMMAND.key("cell", "insertion"))
    assert key == "connection/3/forefeel/cell/insertion/master/command"
    assert topics.parse_key(key) is None
