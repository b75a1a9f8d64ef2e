"""Messages of every type, drawn from the fields that the type declares."""

import string
from enum import Enum
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import annotated_types
from hypothesis import strategies as st
from pydantic.fields import FieldInfo

from forefeel.common.messages import Message

KINDS: tuple[type[Message], ...] = tuple(Message.__subclasses__())
NAME_LETTERS = string.ascii_letters + string.digits + "_.-"
MOST_ITEMS = 8
MOST_LETTERS = 40  # more of them take time and find nothing; the longest texts have a test of their own


def messages(kind: type[Message]) -> st.SearchStrategy[Message]:
    """Any message of the type that speaks our protocol."""
    fields = {name: _field(info) for name, info in kind.model_fields.items() if name != "protocol"}
    return st.builds(kind, **fields)


def _field(info: FieldInfo) -> st.SearchStrategy[Any]:
    return _values(info.annotation, tuple(info.metadata))


def _values(kind: Any, rules: tuple[Any, ...]) -> st.SearchStrategy[Any]:  # noqa: ANN401 - a type
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _values(arguments[0], (*_flat(arguments[1:]), *rules))
    if origin in (Union, UnionType):
        return st.one_of(*(_values(argument, rules) for argument in arguments))
    if origin is tuple:
        return st.lists(_values(arguments[0], ()), max_size=MOST_ITEMS).map(tuple)
    if origin is dict:
        most = min(
            [MOST_ITEMS, *(rule.max_length for rule in rules if isinstance(rule, annotated_types.MaxLen))]
        )
        return st.dictionaries(_values(arguments[0], ()), _values(arguments[1], ()), max_size=most)
    if origin is Literal:
        return st.sampled_from(arguments)
    return _scalars(kind, rules)


def _scalars(kind: type, rules: tuple[Any, ...]) -> st.SearchStrategy[Any]:
    if issubclass(kind, Enum):
        return st.sampled_from(list(kind))
    simple: dict[type, st.SearchStrategy[Any]] = {NoneType: st.none(), bool: st.booleans()}
    if kind in simple:
        return simple[kind]
    if kind is float:
        return st.floats(*bounds(rules))
    return st.integers(*bounds(rules)) if kind is int else _texts(rules)


def bounds(rules: tuple[Any, ...]) -> tuple[Any, Any]:
    """The range that a number has; every one has one."""
    low: list[Any] = [rule.ge for rule in rules if isinstance(rule, annotated_types.Ge)]
    high: list[Any] = [rule.le for rule in rules if isinstance(rule, annotated_types.Le)]
    return max(low), min(high)


def float_ranges(info: FieldInfo) -> list[tuple[float, float]]:
    """The range of each float that a field may hold."""

    def found(kind: Any, rules: tuple[Any, ...]) -> list[tuple[float, float]]:  # noqa: ANN401 - a type
        arguments = get_args(kind)
        if get_origin(kind) is Annotated:
            return found(arguments[0], (*_flat(arguments[1:]), *rules))
        if kind is float:
            return [bounds(rules)]
        return [each for argument in arguments for each in found(argument, rules)]

    return found(info.annotation, tuple(info.metadata))


def _texts(rules: tuple[Any, ...]) -> st.SearchStrategy[str]:
    longest = min(rule.max_length for rule in rules if isinstance(rule, annotated_types.MaxLen))
    if any(getattr(rule, "pattern", None) for rule in rules):
        return st.text(NAME_LETTERS, min_size=1, max_size=min(longest, MOST_LETTERS))
    return st.text(st.characters(codec="utf-8"), max_size=min(longest, MOST_LETTERS))


def _flat(rules: tuple[Any, ...]) -> list[Any]:
    return [part for rule in rules for part in (rule.metadata if isinstance(rule, FieldInfo) else [rule])]


any_message = st.one_of(*map(messages, KINDS))
