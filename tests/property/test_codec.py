import math
import struct
from random import Random
from typing import Any

import msgpack
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from forefeel.common.codec import MOST_BATCHED, decode, decode_batch, encode, encode_batch
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


def by_the_model(kind: type[Message], payload: bytes) -> Message | None:
    """What msgpack and the pydantic model make of the bytes, the definition; None for a refusal."""
    if len(payload) > kind.most_bytes:
        return None
    most = {"max_array_len": kind.most_items, "max_map_len": kind.most_items}
    try:
        message = kind.model_validate(msgpack.unpackb(payload, use_list=False, **most))
    except (ValueError, TypeError, RecursionError):
        return None
    return message if message.protocol == PROTOCOL_VERSION or kind is Handshake else None


def decoded(kind: type[Message], payload: bytes) -> Message | None:
    """The message, or None for a CodecError of one line, as the model says it; any other exception fails the
    test.
    """
    expected = by_the_model(kind, payload)
    try:
        found = decode(kind, payload)
    except CodecError as error:
        assert len(str(error).splitlines()) == 1
        found = None
    assert (found is None) == (expected is None), payload
    if found is not None:
        assert expected is not None
        assert type(found) is kind
        assert bits(dict(found)) == bits(dict(expected))
    return found


@pytest.mark.parametrize("kind", KINDS)
@given(data=st.data())
def test_every_message_comes_back_bit_for_bit(kind: type[Message], data: st.DataObject) -> None:
    message = data.draw(messages(kind))
    back = decoded(kind, encode(message))
    assert back == message
    assert back is not None
    assert bits(dict(back)) == bits(dict(message))
    assert back.model_dump_json() == message.model_dump_json()
    assert back.model_copy(update={"sequence": 1}) == message.model_copy(update={"sequence": 1})


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
def test_every_truncation_is_refused_and_so_are_trailing_bytes(message: Message, data: st.DataObject) -> None:
    payload = encode(message)
    length = data.draw(st.integers(0, len(payload) - 1))
    assert decoded(type(message), payload[:length]) is None
    assert decoded(type(message), payload + data.draw(st.binary(min_size=1, max_size=9))) is None


@given(any_message, st.integers(0, 2**32))
@settings(max_examples=100)
def test_thousand_random_payloads_are_what_the_model_says(message: Message, seed: int) -> None:
    """Random bytes, and a message some of whose bytes are others, cut out or doubled: 100,000 in all."""
    random, whole = Random(seed), encode(message)
    for number in range(1000):
        payload = bytearray(random.randbytes(random.randrange(64)) if number % 10 == 0 else whole)
        for _ in range(random.randint(1, 3)):
            at = random.randrange(len(payload) + 1)
            payload[at : at + random.randint(0, 2)] = random.randbytes(random.randint(0, 2))
        decoded(type(message), bytes(payload))


@pytest.mark.parametrize("kind", KINDS)
@given(data=st.data())
@settings(max_examples=10)
def test_a_batch_gives_its_messages_in_order(kind: type[Message], data: st.DataObject) -> None:
    sent = data.draw(st.lists(messages(kind), max_size=4))
    batch = encode_batch([encode(each) for each in sent])
    assert decode_batch(kind, batch) == sent
    assert decode_batch(kind, batch, step=2, first=1) == [
        one for at, one in enumerate(sent) if at % 2 == 1 or at == len(sent) - 1
    ]


@pytest.mark.parametrize("count", [MOST_BATCHED + 1, 2**32 - 1])
@given(message=any_message)
@settings(max_examples=10)
def test_a_batch_of_too_many_is_refused(count: int, message: Message) -> None:
    payload = encode_batch([encode(message)] * (MOST_BATCHED + 1))
    with pytest.raises(CodecError):
        decode_batch(type(message), payload[:1] + count.to_bytes(4, "big") + payload[5:])


THINGS = st.recursive(
    st.sampled_from([None, True, False])
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats()
    | st.text(max_size=20)
    | st.binary(max_size=8)
    | st.builds(msgpack.ExtType, st.integers(0, 127), st.binary(max_size=4)),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.text(max_size=6) | st.integers(0, 9), inner, max_size=4)
    ),
    max_leaves=12,
)


@given(KIND, THINGS)
@example(Handshake, {b"": 1})
@example(Handshake, {"protocol": {"protocol": 1}})
def test_any_other_msgpack_is_refused(kind: type[Message], thing: object) -> None:
    assert decoded(kind, msgpack.packb(thing)) is None


@given(any_message, THINGS, st.data())
def test_a_field_of_any_value_is_what_the_model_says(
    message: Message, thing: object, data: st.DataObject
) -> None:
    name = data.draw(st.sampled_from(sorted(type(message).model_fields)))
    decoded(type(message), msgpack.packb({**dict(message), name: thing}))


@given(any_message, st.text(max_size=20), THINGS)
def test_an_extra_field_is_refused(message: Message, name: str, thing: object) -> None:
    if name in type(message).model_fields:
        return
    assert decoded(type(message), msgpack.packb({**dict(message), name: thing})) is None


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
