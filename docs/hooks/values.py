"""What a field of a pydantic model may hold, in words, from its annotation. Pure."""

import json
from collections.abc import Callable, Iterable
from datetime import date
from enum import Enum
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from docs.hooks.markdown import code
from forefeel.common.causes.model import ContactModel
from forefeel.common.hardware.driver import DriverSettings, installed_drivers

Link = Callable[[type], str]
_NAMES: dict[Any, str] = {
    bool: "true or false", int: "integer", float: "number", str: "text", Path: "path", date: "date",
    NoneType: "`null`", ContactModel: "a contact model: `effects` as in a model.yaml",
}  # fmt: skip
_BOUNDS = ("ge", "gt", "le", "lt", "min_length", "max_length", "multiple_of", "pattern")


def values(annotation: Any, metadata: Iterable[object], link: Link) -> str:  # noqa: ANN401 - any annotation
    """`annotation` with the bounds of `metadata` in words; models and enumerations by `link`."""
    bounds = _bounds(metadata)
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return values(arguments[0], [*annotation.__metadata__, *metadata], link)
    if origin in {Union, UnionType}:
        return " or ".join(values(each, (), link) for each in arguments)
    if origin is not None:
        return _several(origin, arguments, bounds, link)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return " or ".join(map(link, models(annotation)))
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        return link(annotation)
    return _NAMES[annotation] + _range(bounds, annotation is str)


def default(field: FieldInfo) -> str:
    """What holds where nothing is given."""
    if field.is_required():
        return "required"
    value = field.get_default(call_default_factory=True)
    if isinstance(value, dict) and "driver" in value:
        return code(value["driver"])
    if isinstance(value, BaseModel):
        driver = getattr(value, "driver", None) or getattr(value, "preset", None)
        return code(driver) if driver else "its defaults"
    if isinstance(value, tuple) and any(isinstance(each, BaseModel) for each in value):
        return f"{len(value)} with its defaults"
    return code(json.dumps(value.value if isinstance(value, Enum) else value))


def models(annotation: Any) -> list[type[BaseModel]]:  # noqa: ANN401 - any annotation
    """The models that an annotation names, however deep; of a driver's section those of every driver."""
    if isinstance(annotation, type) and get_origin(annotation) is None:
        if issubclass(annotation, DriverSettings) and "slot" in vars(annotation):
            return [found.driver.settings for found in installed_drivers(annotation.slot)]
        return [annotation] if issubclass(annotation, BaseModel) else []
    return [found for each in get_args(annotation) for found in models(each)]


def _bounds(metadata: Iterable[object]) -> dict[str, Any]:
    flat = [each for one in metadata for each in (one.metadata if isinstance(one, FieldInfo) else [one])]
    found = {name: getattr(one, name, None) for name in _BOUNDS for one in flat if hasattr(one, name)}
    return {name: bound for name, bound in found.items() if bound is not None}


def _several(origin: Any, arguments: tuple[Any, ...], bounds: dict[str, Any], link: Link) -> str:  # noqa: ANN401
    if origin is Literal:
        return ", ".join(code(each) for each in arguments)
    if origin is dict:
        return f"map of {values(arguments[0], (), link)} to {values(arguments[1], (), link)}"
    return _tuple(arguments, bounds, link)


def _tuple(arguments: tuple[Any, ...], bounds: dict[str, Any], link: Link) -> str:
    if len(arguments) == 2 and arguments[1] is Ellipsis:
        return f"list of {values(arguments[0], (), link)}{_range(bounds, True)}"
    return f"[{', '.join(values(each, (), link) for each in arguments)}]"


def _range(bounds: dict[str, Any], counted: bool) -> str:
    """`counted`: the bounds are of a length."""
    parts = []
    low = _end(bounds, "ge", "gt", "above ", "at least ")
    high = _end(bounds, "le", "lt", "below ", "at most ")
    if low and high:
        parts.append(f"{low.removeprefix('at least ')} to {high.removeprefix('at most ')}")
    elif low or high:
        parts.append(low or high)
    shortest, longest = bounds.get("min_length"), bounds.get("max_length")
    if counted and (shortest or longest):
        ends = [f"at least {shortest}"] if shortest else []
        parts.append(", ".join([*ends, *([f"at most {longest}"] if longest else [])]) + " long")
    if "multiple_of" in bounds:
        parts.append(f"a multiple of {bounds['multiple_of']}")
    if "pattern" in bounds:
        parts.append(f"like {code(bounds['pattern'])}")
    return f", {', '.join(parts)}" if parts else ""


def _end(bounds: dict[str, Any], closed: str, opened: str, out: str, within: str) -> str:
    if closed in bounds:
        return within + _number(bounds[closed])
    return out + _number(bounds[opened]) if opened in bounds else ""


def _number(value: float) -> str:
    if isinstance(value, int):
        for power, off in ((63, 1), (63, 0), (31, 0)):
            if abs(value) == 2**power - off:
                return f"{'-' if value < 0 else ''}2^{power}{' - 1' if off else ''}"
        return str(value)
    return f"{value:g}"
