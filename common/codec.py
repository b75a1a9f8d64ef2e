"""Message <-> msgpack. The pydantic models say what a message is; msgspec reads its bytes by a struct that is
made of each model once, in a third of the time, and builds nothing that the model does not name.

Every byte string that is not a message gives one `CodecError`, nothing else.
"""

from collections.abc import Sequence
from functools import cache
from types import UnionType
from typing import Annotated, Any, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import msgpack
import msgspec
from pydantic.fields import FieldInfo

from forefeel.common.errors import CodecError
from forefeel.common.messages import PROTOCOL_VERSION, Handshake, Message

# bytes, the largest `most_bytes` of any message
MAX_MESSAGE_BYTES = 64 * 1024

MOST_BATCHED = 256
"""Messages in a batch: a quarter of a second at 1 kHz."""

M = TypeVar("M", bound=Message)
_set = object.__setattr__
_RULES = "ge", "le", "min_length", "max_length", "pattern"
_ARRAY = b"\xdd"  # of msgpack, with 32 bits of length
_RAW = msgspec.msgpack.Decoder(Annotated[list[msgspec.Raw], msgspec.Meta(max_length=MOST_BATCHED)])
_REFUSED = (msgspec.DecodeError, ValueError, RecursionError)


def encode(message: Message) -> bytes:
    """The message as one msgpack map, field name to value."""
    packed: bytes = msgpack.packb(message.__dict__)
    return packed


def decode(kind: type[M], payload: bytes) -> M:
    """The message of type `kind` that `payload` holds.

    Raises:
        CodecError: the bytes are no message of that type, or speak another protocol version.
    """
    if len(payload) > kind.most_bytes:
        raise CodecError(f"message of {len(payload)} bytes, at most {kind.most_bytes} are accepted")
    try:
        fields = _decoders(kind)[0].decode(payload)
    except _REFUSED as error:
        raise _refusal(kind, error) from error
    return _message(kind, fields)


def encode_batch(payloads: list[bytes]) -> bytes:
    """Joins encoded messages of one type into one msgpack array."""
    size = len(payloads)
    return _ARRAY + size.to_bytes(4, "big") + b"".join(payloads)


def decode_batch(kind: type[M], payload: bytes, step: int = 1, first: int = 0) -> list[M]:
    """Messages of type `kind` in a batch, at most `MOST_BATCHED`, or the single message that `payload` is.
    With `step` only those at `first`, `first` + `step`, ... and the last; the others are not checked.

    Raises:
        CodecError: one of them is no message of that type or protocol version, or there are more.
    """
    if payload[:1] != _ARRAY:
        return [decode(kind, payload)]
    try:
        if step > 1:
            raws = _RAW.decode(payload)
            return [decode(kind, bytes(raws[at])) for at in picked(len(raws), step, first)]
        batch = _decoders(kind)[1].decode(payload)
    except _REFUSED as error:
        raise _refusal(kind, error) from error
    return [_message(kind, fields) for fields in batch]


def counted(payload: bytes) -> int:
    """Number of messages in a payload by its head: 1, or that of a batch, at most `MOST_BATCHED`."""
    return min(int.from_bytes(payload[1:5], "big"), MOST_BATCHED) if payload[:1] == _ARRAY else 1


def picked(number: int, step: int, first: int) -> list[int]:
    """Indices, sorted, of `number` messages: `first`, `first` + `step`, ... and the last one."""
    return sorted({*range(first, number, step), *range(number)[-1:]})


def _refusal(kind: type[Message], error: Exception) -> CodecError:
    text = repr(str(error))[1:-1]  # may hold a name from the network: one line
    return CodecError(f"{kind.__name__}: {text[-200:]}")


def _message(kind: type[M], fields: msgspec.Struct) -> M:
    """Builds a message of type `kind` from decoded fields, without pydantic's validation. Raises CodecError
    for another protocol version, except in a Handshake.
    """
    message = kind.__new__(kind)
    values = msgspec.structs.asdict(fields)
    _set(message, "__dict__", values)
    _set(message, "__pydantic_fields_set__", _names(kind))
    _set(message, "__pydantic_extra__", None)
    _set(message, "__pydantic_private__", None)
    if values["protocol"] != PROTOCOL_VERSION and kind is not Handshake:
        raise CodecError(
            f"{kind.__name__}: protocol {values['protocol']}, this end speaks {PROTOCOL_VERSION}"
        )
    return message


@cache
def _names(kind: type[Message]) -> set[str]:
    return set(kind.model_fields)


def _struct(kind: type[Message]) -> type[msgspec.Struct]:
    """Makes the msgspec struct of a message type: its fields with type, range and default, and no others.

    Decoding builds an array of whatever length the bytes claim, hence the type's `most_items` bounds every
    array field that states no bound.
    """
    hints = get_type_hints(kind, include_extras=True)
    fields = [
        (name, _type(hints[name], kind.most_items), *([] if info.is_required() else [info.default]))
        for name, info in kind.model_fields.items()
    ]
    return msgspec.defstruct(kind.__name__, fields, kw_only=True, forbid_unknown_fields=True, gc=False)


@cache
def _decoders(kind: type[Message]) -> tuple["msgspec.msgpack.Decoder[Any]", "msgspec.msgpack.Decoder[Any]"]:
    """Decoders of one message's fields, and of a batch."""
    fields: Any = _struct(kind)
    batch = Annotated[list[fields], msgspec.Meta(max_length=MOST_BATCHED)]
    return msgspec.msgpack.Decoder(fields), msgspec.msgpack.Decoder(batch)


def _type(hint: Any, most_items: int, rules: Sequence[Any] = ()) -> Any:  # noqa: ANN401 - a type
    """Translates the type of a pydantic field to msgspec, with the range, length and pattern in `rules`
    (pydantic's metadata of the field). A tuple or dict without a greatest length gets `most_items`.
    """
    origin, inner = get_origin(hint), get_args(hint)
    if origin is Annotated:
        rules = [rule for info in inner[1:] if isinstance(info, FieldInfo) for rule in info.metadata]
        return _type(inner[0], most_items, rules)
    if origin in (Union, UnionType):
        return Union[tuple(_type(part, most_items) for part in inner)]  # noqa: UP007 - of a tuple
    bounds = {name: getattr(rule, name) for rule in rules for name in _RULES if hasattr(rule, name)}
    if pattern := bounds.get("pattern"):
        bounds["pattern"] = pattern.removesuffix("$") + r"\Z"  # pydantic's `$` takes no line end before it
    if origin in (tuple, dict):
        bounds.setdefault("max_length", most_items)
        types = tuple(part if part is ... else _type(part, most_items) for part in inner)
        hint = origin[types]
    return Annotated[hint, msgspec.Meta(**bounds)] if bounds else hint


class Codec:
    """Messages as bytes, as they go over a transport."""

    encode = staticmethod(encode)
    decode = staticmethod(decode)
    encode_batch = staticmethod(encode_batch)
    decode_batch = staticmethod(decode_batch)


class Objects(Codec):
    """Passes message objects themselves as payloads, within one process; no range is checked."""

    @staticmethod
    def encode(message: Message) -> bytes:
        return cast("bytes", message)

    @staticmethod
    def decode(kind: type[M], payload: bytes) -> M:
        del kind
        return cast("M", payload)

    @staticmethod
    def encode_batch(payloads: list[bytes]) -> bytes:
        return cast("bytes", tuple(payloads))

    @staticmethod
    def decode_batch(kind: type[M], payload: bytes, step: int = 1, first: int = 0) -> list[M]:
        del kind
        batch = cast("tuple[M, ...]", payload)
        return [batch[at] for at in picked(len(batch), step, first)]
