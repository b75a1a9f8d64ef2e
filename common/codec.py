"""Message <-> msgpack. Every byte string that is not a message gives one `CodecError`, nothing else."""

from typing import TypeVar

import msgpack
from pydantic import ValidationError

from forefeel.common.errors import CodecError
from forefeel.common.messages import PROTOCOL_VERSION, Handshake, Message

# bytes, the largest `most_bytes` of any message
MAX_MESSAGE_BYTES = 64 * 1024
_MAX_ITEMS = 1024  # items of an array or map, the largest `most_items` of any message; see `unpack`

M = TypeVar("M", bound=Message)


def encode(message: Message) -> bytes:
    """The message as one msgpack map, field name to value."""
    packed: bytes = msgpack.packb(message.__dict__)
    return packed


def unpack(
    payload: bytes, most_bytes: int = MAX_MESSAGE_BYTES, most_items: int = _MAX_ITEMS
) -> dict[str, object]:
    """The bare map of a payload, its size and shape checked but its fields not.

    An array is built as long as it claims to be, at every level of nesting: 64 kB that claim 1000 arrays of
    65536 in one another hold the interpreter, and with it the control loop, for 0.1 s. So its length is
    bounded, too.

    Raises:
        CodecError: empty, oversized, truncated, trailing bytes, or not a map with text keys.
    """
    if len(payload) > most_bytes:
        raise CodecError(f"message of {len(payload)} bytes, at most {most_bytes} are accepted")
    try:
        fields = msgpack.unpackb(payload, use_list=False, max_array_len=most_items, max_map_len=most_items)
    except (ValueError, TypeError, RecursionError) as error:  # msgpack's own errors are ValueErrors
        raise CodecError(f"not msgpack: {type(error).__name__}") from error
    if type(fields) is not dict:
        raise CodecError(f"expected a map of fields, got {type(fields).__name__}")
    if not all(type(name) is str for name in fields):
        raise CodecError("expected field names of text")
    return fields


def decode(kind: type[M], payload: bytes) -> M:
    """The message of type `kind` that `payload` holds.

    Raises:
        CodecError: the bytes are no message of that type, or speak another protocol version.
    """
    fields = unpack(payload, kind.most_bytes, kind.most_items)
    try:
        message = kind.model_validate(fields)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        place = repr(".".join(str(part) for part in first["loc"]))[1:-1]  # a name from the network: one line
        raise CodecError(f"{kind.__name__}.{place}: {first['msg']}") from error
    if message.protocol != PROTOCOL_VERSION and kind is not Handshake:
        raise CodecError(f"{kind.__name__}: protocol {message.protocol}, this end speaks {PROTOCOL_VERSION}")
    return message
