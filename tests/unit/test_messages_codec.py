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
    ForceSample,
    Grip,
    Handshake,
    Heartbeat,
    Message,
    MotionCommand,
    SafetyState,
    SlaveState,
)
from forefeel.common.topics import TOPICS
from tests.message_samples import KINDS

HEADER: Header = {"session_id": 7, "sequence": 1, "stamp_ns": 123}
COMMAND = {**HEADER, "position_m": 0.01, "velocity_m_s": 0.0, "deadman": True}
HANDSHAKE = {**HEADER, "role": "master", "instance_id": 1, "software": "forefeel", "settings_hash": "00"}


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
    assert msgpack.unpackb(encode(message)) == {
        "protocol": PROTOCOL_VERSION,
        **HEADER,
        "position_m": 0.01,
        "velocity_m_s": 0.5,
        "deadman": True,
        "gripper": "closed",
        "recording_time_s": None,
        "low_n": None,
        "high_n": None,
    }


def test_states_and_grips_come_back_as_what_they_were() -> None:
    state = SlaveState(
        **HEADER,
        state=SafetyState.ARMED,
        reason="",
        position_m=0.0,
        velocity_m_s=0.0,
        gripper=Grip.OPEN,
        stops=0,
        clock_offset_ns=None,
        clock_bound_ns=None,
        counters={"a.b-c_1": 2},
    )
    back = decode(SlaveState, encode(state))
    assert back.state is SafetyState.ARMED
    assert back.gripper is Grip.OPEN


def test_every_type_that_crosses_the_network_is_known_to_the_samples() -> None:
    assert {topic.message for topic in TOPICS} == set(KINDS)


@pytest.mark.parametrize("kind", KINDS)
def test_messages_are_frozen(kind: type[Message]) -> None:
    message = kind.model_construct(set(), **HEADER)
    with pytest.raises(ValidationError, match="frozen"):
        setattr(message, "sequence", 2)  # noqa: B010 - mypy refuses the plain form, as it should


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("field", ["position_m", "velocity_m_s", "recording_time_s"])
def test_a_number_that_is_not_finite_is_refused_on_the_way_in(field: str, number: float) -> None:
    assert refusal(MotionCommand, command(**{field: number})).endswith(f"at `$.{field}`")


def test_a_number_that_is_not_finite_is_refused_on_the_way_out() -> None:
    with pytest.raises(ValidationError, match="finite"):
        MotionCommand(**HEADER, position_m=math.nan, velocity_m_s=0.0, deadman=True)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("position_m", "0.01"),
        ("position_m", True),
        ("position_m", None),
        ("deadman", 1),
        ("deadman", "true"),
        ("sequence", 1.0),
        ("sequence", -1),
        ("sequence", True),
        ("sequence", 2**63),
        ("session_id", 2**64 - 1),
        ("stamp_ns", 2**63),
        ("stamp_ns", "0"),
        ("gripper", "ajar"),
        ("gripper", 0),
        ("protocol", 0),
        ("protocol", None),
    ],
)
def test_nothing_is_converted_or_out_of_range(field: str, value: object) -> None:
    assert refusal(MotionCommand, command(**{field: value})).endswith(f"at `$.{field}`")


def test_a_whole_number_stands_for_a_float() -> None:
    position_m = decode(MotionCommand, command(position_m=2)).position_m
    assert (type(position_m), position_m) == (float, 2.0)


def test_an_unknown_field_is_refused() -> None:
    assert refusal(MotionCommand, command(**{"a\nb": 1})).endswith("unknown field `a\\nb`")


def test_a_missing_field_is_refused() -> None:
    assert refusal(MotionCommand, msgpack.packb(HEADER)).endswith("missing required field `position_m`")


def test_the_message_of_another_topic_is_refused() -> None:
    heartbeat = encode(Heartbeat(**HEADER))
    assert "unknown field `echo_stamp_ns`" in refusal(MotionCommand, heartbeat)


def test_another_protocol_is_refused_and_named() -> None:
    assert (
        refusal(MotionCommand, command(protocol=1))
        == f"MotionCommand: protocol 1, this end speaks {PROTOCOL_VERSION}"
    )


def test_a_handshake_of_another_protocol_is_read_so_that_it_can_be_answered() -> None:
    assert decode(Handshake, msgpack.packb({**HANDSHAKE, "protocol": 9})).protocol == 9


def test_a_text_of_the_longest_length_crosses_in_any_script() -> None:
    widest = Handshake(
        **HEADER, role="master", instance_id=1, software="", settings_hash="", settings="\U0001f9b4" * 4096
    )
    assert decode(Handshake, encode(widest)) == widest


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"\xc1",  # never used by msgpack
        b"\x01",
        b"\x90",
        b"\xc0",
        msgpack.packb([1, 2]),
        msgpack.packb("text"),
        b"\x81\xa1\xff\x01",  # a key that is no UTF-8
        msgpack.packb({1: 2}),
        msgpack.packb({b"": 1}),
        msgpack.packb({(1, 2): 3}),
        b"\x91" * 2000 + b"\xc0",  # nested deeper than any parser goes
        b"\x81\xa1a" * 2000 + b"\xc0",
        b"\xdd\xff\xff\xff\xff",  # claims 4 G items
        b"\xdf\xff\xff\xff\xff",
        b"\xdb\xff\xff\xff\xff",
        b"\xc6\xff\xff\xff\xff",
    ],
)
def test_what_is_no_map_of_fields_gives_one_error(payload: bytes) -> None:
    with pytest.raises(CodecError) as caught:
        decode(MotionCommand, payload)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    "value",
    [msgpack.Timestamp(1), msgpack.ExtType(5, b"12345"), b"bytes", "x" * 1000, [0.0] * 64, {"0.0": 0.0}],
)
@pytest.mark.parametrize("field", ["position_m", "gripper", "sequence", "unknown"])
def test_no_kind_of_msgpack_value_passes_for_a_number_or_a_grip(field: str, value: object) -> None:
    assert field in refusal(MotionCommand, command(**{field: value}))


def test_counts_beyond_64_bits_are_refused_before_they_are_sent() -> None:
    fields: dict[str, Any] = dict(
        **HEADER, position_m=0.0, velocity_m_s=0.0, force_n=0.0, answers_sequence=None, answers_stamp_ns=None
    )
    with pytest.raises(ValidationError, match="raw_counts"):
        ForceSample(**fields, raw_counts=2**63, valid=True)


@pytest.mark.parametrize("kind", [MotionCommand, EmergencyStop, Heartbeat])
def test_no_message_is_read_that_is_larger_than_its_kind(kind: type[Message]) -> None:
    with pytest.raises(CodecError, match="2049 bytes, at most 2048"):
        decode(kind, bytes(2049))
