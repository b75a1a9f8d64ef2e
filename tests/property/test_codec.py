import math
import struct
from typing import Any

import msgpack
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from forefeel.common.codec import MAX_MESSAGE_BYTES, decode, encode, unpack
from forefeel.common.errors import CodecError
from forefeel.common.messages import PROTOCOL_VERSION, Handshake, Message
from tests.message_samples import KINDS, any_message, float_ranges, messages

KIND = st.sampled_from(KINDS)


def bits(value: Any) -> Any:  # noqa: ANN401 - whatever a field holds
    """A value with its type; floats by their 64 bits, so that -0.0 is not 0.0."""
    if isinstance(value, float):
        return struct.pack(">d", value)
    if isinstance(value, tuple):
        return tuple(bits(part) for part in value)
    if isinstance(value, dict):
        return {key: bits(part) for key, part in value.items()}
    return type(value), value


def decoded(kind: type[Message], payload: bytes) -> Message | None:
    """The message, or None for a CodecError of one line; any other exception fails the test."""
    try:
        return decode(kind, payload)
    except CodecError as error:
        assert len(str(error).splitlines()) == 1
        return None


@pytest.mark.parametrize("kind", KINDS)
@given(data=st.data())
def test_every_message_comes_back_bit_for_bit(kind: type[Message], data: st.DataObject) -> None:
    message = data.draw(messages(kind))
    back = decode(kind, encode(message))
    assert bits(dict(back)) == bits(dict(message))
    assert encode(back) == encode(message)


@pytest.mark.parametrize("kind", KINDS)
@given(data=st.data())
@settings(max_examples=5)
def test_every_number_has_a_range_whose_ends_cross_and_no_more(
    kind: type[Message], data: st.DataObject
) -> None:
    fields = dict(data.draw(messages(kind)))
    for name, info in kind.model_fields.items():
        for low, high in float_ranges(info):
            assert -math.inf < low < high < math.inf, name
            many = str(info.annotation).startswith("tuple")
            for value, fits in ((low, True), (high, True), (1.01 * high, False), (1e300, False)):
                back = decoded(kind, msgpack.packb({**fields, name: [value] if many else value}))
                assert (back is not None) == fits, name


@given(any_message, st.data())
def test_every_truncation_is_refused(message: Message, data: st.DataObject) -> None:
    payload = encode(message)
    length = data.draw(st.integers(0, len(payload) - 1))
    with pytest.raises(CodecError):
        decode(type(message), payload[:length])


@given(any_message, st.binary(min_size=1, max_size=9))
def test_trailing_bytes_are_refused(message: Message, rest: bytes) -> None:
    with pytest.raises(CodecError):
        decode(type(message), encode(message) + rest)


@given(any_message, st.data())
def test_corrupted_bytes_give_a_valid_message_or_one_codec_error(
    message: Message, data: st.DataObject
) -> None:
    payload = bytearray(encode(message))
    for _ in range(data.draw(st.integers(1, 4))):
        payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    back = decoded(type(message), bytes(payload))
    if back is not None:
        assert type(back).model_validate(dict(back)) == back
        assert decode(type(back), encode(back)) == back


@given(KIND, st.binary(max_size=200))
def test_random_bytes_are_refused(kind: type[Message], payload: bytes) -> None:
    with pytest.raises(CodecError):
        decode(kind, payload)


THINGS = st.recursive(
    st.one_of(
        st.none(),
        st.booleans(),
        st.integers(-(2**63), 2**64 - 1),
        st.floats(),
        st.text(max_size=20),
        st.binary(max_size=8),
        st.builds(msgpack.ExtType, st.integers(0, 127), st.binary(max_size=4)),
    ),
    lambda inner: st.one_of(
        st.lists(inner, max_size=4),
        st.dictionaries(st.text(max_size=6) | st.integers(0, 9), inner, max_size=4),
    ),
    max_leaves=12,
)


@given(KIND, THINGS)
@example(Handshake, {b"": 1})
@example(Handshake, {"protocol": {"protocol": 1}})
def test_any_other_msgpack_is_refused(kind: type[Message], thing: object) -> None:
    with pytest.raises(CodecError):
        decode(kind, msgpack.packb(thing))


@given(any_message, THINGS, st.data())
def test_a_field_of_any_wrong_value_is_refused_or_right(
    message: Message, thing: object, data: st.DataObject
) -> None:
    name = data.draw(st.sampled_from(sorted(type(message).model_fields)))
    back = decoded(type(message), msgpack.packb({**dict(message), name: thing}))
    if back is not None:
        value = getattr(back, name)
        assert not isinstance(value, float) or math.isfinite(value)
        assert value == (tuple(thing) if isinstance(thing, list) else thing)


@given(any_message, st.text(max_size=20), THINGS)
def test_an_extra_field_is_refused(message: Message, name: str, thing: object) -> None:
    if name in type(message).model_fields:
        return
    with pytest.raises(CodecError):
        decode(type(message), msgpack.packb({**dict(message), name: thing}))


@given(any_message, st.data())
def test_a_missing_field_takes_its_default_or_is_refused(message: Message, data: st.DataObject) -> None:
    fields = type(message).model_fields
    name = data.draw(st.sampled_from(sorted(fields)))
    payload = msgpack.packb({key: value for key, value in dict(message).items() if key != name})
    back = decoded(type(message), payload)
    assert (back is None) == fields[name].is_required()
    if back is not None:
        assert getattr(back, name) == fields[name].default


@given(any_message, st.integers(1, 2**31).filter(lambda version: version != PROTOCOL_VERSION))
def test_another_protocol_is_understood_of_a_handshake_only(message: Message, protocol: int) -> None:
    back = decoded(type(message), encode(message.model_copy(update={"protocol": protocol})))
    assert (back is not None) == isinstance(message, Handshake)


@given(any_message, st.integers(1, 100))
def test_an_oversized_message_is_refused_unread(message: Message, excess: int) -> None:
    payload = encode(message)
    padding = bytes(MAX_MESSAGE_BYTES + excess - len(payload))
    with pytest.raises(CodecError, match=f"{MAX_MESSAGE_BYTES + excess} bytes"):
        unpack(payload + padding)
