"""YAML -> frozen settings. Every mistake is one line: file, line, place, value, what was expected."""

import os
import re
from difflib import get_close_matches
from pathlib import Path
from typing import Any, ClassVar, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, ValidationError, ValidationInfo, model_validator
from pydantic_core import ErrorDetails, PydanticCustomError

from forefeel.common.errors import ConfigurationError
from forefeel.common.yaml_file import KINDS, Place, dump_mapping, load_yaml, shown_key


class Settings(BaseModel):
    """Base of all settings: frozen, unknown keys refused, finite numbers."""

    model_config: ClassVar[ConfigDict] = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, validate_default=True, protected_namespaces=()
    )

    @model_validator(mode="before")
    @classmethod
    def _known_keys_and_true_numbers(cls, data: Any) -> Any:  # noqa: ANN401 - raw input of pydantic
        """Checks the keys and values of a dict; returns the data unchanged. Raises PydanticCustomError: an
        unknown key, with the nearest known one; ValueError: a truth value for a field that takes none, or
        text for a number (YAML reads yes and on as true).
        """
        for name, value in data.items() if isinstance(data, dict) else ():
            if name not in cls.model_fields:
                known = sorted(cls.model_fields)
                expected = get_close_matches(str(name), known, n=1) or ["one of " + ", ".join(known)]
                raise PydanticCustomError(
                    "unknown_key", "unknown key {key}", {"key": str(name), "expected": expected[0]}
                )
            values = value if isinstance(value, list | tuple) else [value]
            kinds = _leaves(cls.model_fields[name].annotation)
            if bool not in kinds and any(isinstance(entry, bool) for entry in values):
                raise ValueError(f"{name} = {value}: expected no truth value (YAML reads yes and on as true)")
            if kinds & {int, float} and str not in kinds and any(map(_is_quoted_number, values)):
                raise ValueError(f"{name} = {value!r}: expected a number, not text")
        return data


def _is_quoted_number(value: object) -> bool:
    try:
        return isinstance(value, str) and bool(float(value) or True)
    except ValueError:
        return False


S = TypeVar("S", bound=BaseModel)
_WHOLE = "(whole file)"
_MOST_NAME, _MOST_PATH = 255, 4095  # bytes (limits.h of Linux): what is longer makes every look at it fail


def load_settings(kind: type[S], path: Path) -> S:
    """The settings of type `kind` that a YAML file holds.

    Raises:
        ConfigurationError: the file or one of its values is wrong; one line for the first mistake.
    """
    data, lines = load_yaml(path)
    return checked(kind, data, str(path), lines, path.parent)


def checked(
    kind: type[S], data: object, where: str, lines: dict[Place, int] | None = None, directory: Path = Path()
) -> S:
    """Validates `data` as settings of type `kind` and returns them; relative paths count from `directory`.

    Raises:
        ConfigurationError: the first mistake in one line: `where`, the line where known, the key, the value,
            what was expected.
    """
    try:
        return kind.model_validate(data, context={"directory": directory})
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise ConfigurationError(_describe(first, where, lines or {})) from error


def beside_the_file(path: Path, info: ValidationInfo) -> Path:
    """Makes a path absolute, relative to the folder of the settings file (in the validation context). Raises
    ValueError for a path that no file can have.
    """
    text = os.fsencode(path)
    if b"\0" in text or len(text) > _MOST_PATH or max(map(len, text.split(b"/"))) > _MOST_NAME:
        raise ValueError("expected a path that a file can have")
    return (Path((info.context or {}).get("directory", "")) / path).absolute()


def _describe(problem: ErrorDetails, where: str, lines: dict[Place, int]) -> str:
    """Line on a mistake that pydantic reports: file, line where known, key, value, what was expected."""
    loc, value = problem["loc"], problem["input"]
    if problem["type"] == "unknown_key":
        loc = (*loc, problem["ctx"]["key"])
    place = _placed(loc, lines)
    line = _line(place, lines)
    dotted = "".join(f"[{p}]" if isinstance(p, int) else f".{shown_key(p)}" for p in place).lstrip(".")
    dotted = dotted or _WHOLE
    expected = problem["msg"].removeprefix("Value error, ")
    match problem["type"]:
        case "unknown_key":
            return f"{where}{line}: {dotted}: unknown key, expected {problem['ctx']['expected']}"
        case "missing":
            return f"{where}{line}: {dotted}: missing, a value is required"
        case "union_tag_invalid" | "union_tag_not_found":
            return _describe_kind(problem["ctx"], where, place, dotted, lines)
    if isinstance(value, dict) and problem["type"] == "value_error":  # a rule over several values names them
        line = _line((*place, *re.split(r"[ :]", expected)[0].split(".")), lines)
        return f"{where}{line}: {'' if dotted == _WHOLE else f'{dotted}: '}{expected}"
    simple = isinstance(value, int | float | str | bool | None)
    shown = f"{value!r:.200}" if simple else KINDS.get(type(value), "a mapping")
    return f"{where}{line}: {dotted} = {shown}: {expected[:1].lower()}{expected[1:]}"


def _describe_kind(
    context: dict[str, Any], where: str, place: Place, dotted: str, lines: dict[Place, int]
) -> str:
    """Text, in one line, for a section whose kind, by its `discriminator`, is unknown or missing."""
    key = str(context["discriminator"]).strip("'")
    head = f"{where}{_line((*place, key), lines)}: {dotted}.{key}"
    if "tag" not in context:
        return f"{head}: missing, a value is required"
    return f"{head} = {shown_key(str(context['tag']))!r}: expected one of {context['expected_tags']}"


def _leaves(annotation: Any) -> set[Any]:  # noqa: ANN401 - any type expression
    """The types and literals that an annotation is made of: `tuple[float, int] | None` has three."""
    inside = [leaf for part in get_args(annotation) for leaf in _leaves(part)]
    return set(inside) if inside else {annotation}


def _line(place: Place, lines: dict[Place, int]) -> str:
    """The line of a place, or of the nearest around it that is known."""
    while place and place not in lines:
        place = place[:-1]
    return f":{lines[place]}" if place in lines else ""


def _placed(loc: Place, lines: dict[Place, int]) -> Place:
    """`loc` as it stands in the file: without the names of union members that pydantic puts in between."""
    place: Place = ()
    for part in loc[:-1]:
        if not lines or (*place, part) in lines:
            place = (*place, part)
    return (*place, *loc[-1:])


def dump_yaml(settings: BaseModel) -> str:
    """The effective settings as YAML, defaults included."""
    return dump_mapping(settings.model_dump(mode="json"))


def deep_merge(base: dict[str, Any], override: dict[str, Any]) -> dict[str, Any]:
    """Copy of `base` with the values of `override` in place of those of the same key; where both are
    mappings, they are merged in the same way.
    """
    merged = dict(base)
    for key, value in override.items():
        both = isinstance(value, dict) and isinstance(merged.get(key), dict)
        merged[key] = deep_merge(merged[key], value) if both else value
    return merged
