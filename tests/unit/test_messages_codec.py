import math
from typing import Any

import msgpack
import pytest
from pydantic import ValidationError

from forefeel.common.bus import Header
from forefeel.common.codec import decode, encode
from forefeel.common.errors import CodecError
from forefeel.common.messages import (
    PROTOCOL_VERSION,
    EmergencyStop,
    Handshake,
    Heartbeat,
    Message,
    MotionCommand,
)
from forefeel.common.topics import TOPICS
from tests.message_samples import KINDS

HEADER: Header = {"session_id": 7, "sequence": 1, "stamp_ns": 123}
COMMAND = {**HEADER, "position_m": 0.01, "velocity_m_s": 0.0, "deadman": True}


def command(**changes: Any) -> bytes:  # noqa: ANN401 - wrong on purpose
    packed: bytes = msgpack.packb({**COMMAND, **changes})
    return packed


def refusal(kind: type[Message], payload: bytes) -> str:
    with pytest.raises(CodecError) as caught:
        decode(kind, payload)
    text = str(caught.value)
    assert len(text.splitlines()) == 1
    return text


def test_a_message_is_one_map_of_its_fields() -> None:
    message = MotionCommand(**HEADER, position_m=0.01, velocity_m_s=0.5, deadman=True)
    absent = dict.fromkeys(("recording_time_s", "low_n", "high_n"))
    sent = {**COMMAND, "protocol": PROTOCOL_VERSION, "velocity_m_s": 0.5, "gripper": "closed", **absent}
    assert msgpack.unpackb(encode(message)) == sent


@pytest.mark.parametrize(
    "fields", [{**COMMAND, "position_m": math.nan}, {**COMMAND, "sequence": 2**63}], ids=["nan", "64 bits"]
)
def test_a_number_that_no_message_holds_is_refused_before_it_is_sent(fields: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        MotionCommand(**fields)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("position_m", "0.01"), ("position_m", True), ("position_m", None), ("position_m", math.nan),
        ("position_m", msgpack.Timestamp(1)), ("position_m", [0.0] * 64), ("velocity_m_s", -math.inf),
        ("recording_time_s", math.inf), ("deadman", 1), ("deadman", "true"), ("sequence", 1.0),
        ("sequence", -1), ("sequence", True), ("sequence", 2**63), ("session_id", 2**64 - 1),
        ("stamp_ns", "0"), ("gripper", "ajar"), ("gripper", 0), ("protocol", 0), ("protocol", None),
    ],
)  # fmt: skip
def test_nothing_is_converted_or_out_of_range_and_the_field_is_named(field: str, value: object) -> None:
    assert refusal(MotionCommand, command(**{field: value})).endswith(f"at `$.{field}`")


@pytest.mark.parametrize(
    ("payload", "words"),
    [
        (command(**{"a\nb": 1}), "unknown field `a\\nb`"),
        (msgpack.packb(HEADER), "missing required field `position_m`"),
        (encode(Heartbeat(**HEADER)), "unknown field `echo_stamp_ns`"),
        (command(protocol=1), f"protocol 1, this end speaks {PROTOCOL_VERSION}"),
    ],
    ids=["unknown", "missing", "of another topic", "of another protocol"],
)
def test_what_is_wrong_with_a_message_is_named(payload: bytes, words: str) -> None:
    assert words in refusal(MotionCommand, payload)


@pytest.mark.parametrize(
    "payload",
    [
        b"\x91" * 2000 + b"\xc0",  # nested deeper than any parser goes
        b"\x81\xa1a" * 2000 + b"\xc0",
        b"\xdd\xff\xff\xff\xff",  # claims 4 G items
        b"\xdf\xff\xff\xff\xff",
        b"\xdb\xff\xff\xff\xff",
        b"\xc6\xff\xff\xff\xff",
    ],
)
def test_bytes_that_claim_more_than_they_hold_cost_nothing(payload: bytes) -> None:
    assert refusal(MotionCommand, payload)


def test_every_type_that_crosses_the_network_is_known_to_the_samples() -> None:
    assert {topic.message for topic in TOPICS} == set(KINDS)


def test_a_text_of_the_longest_length_crosses_in_any_script() -> None:
    widest = Handshake(
        **HEADER, role="master", instance_id=1, software="", settings_hash="", settings="\U0001f9b4" * 4096
    )
    assert decode(Handshake, encode(widest)) == widest


@pytest.mark.parametrize("kind", [MotionCommand, EmergencyStop, Heartbeat])
def test_no_message_is_read_that_is_larger_than_its_kind(kind: type[Message]) -> None:
    with pytest.raises(CodecError, match="2049 bytes, at most 2048"):
        decode(kind, bytes(2049))
