"""YAML -> frozen settings. Every mistake is one line: file, line, place, value, what was expected."""

import re
from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path
from typing import Any, ClassVar, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, ValidationError, ValidationInfo, model_validator
from pydantic_core import ErrorDetails

from forefeel.common.errors import ConfigurationError
from forefeel.common.yaml_file import KINDS, Place, dump_mapping, load_yaml, shown_key


class Settings(BaseModel):
    """Base of all settings: frozen, unknown keys refused, finite numbers."""

    model_config: ClassVar[ConfigDict] = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, validate_default=True, protected_namespaces=()
    )

    @model_validator(mode="before")
    @classmethod
    def _only_numbers_are_numbers(cls, data: Any) -> Any:  # noqa: ANN401 - raw input of pydantic
        """YAML reads yes, no, on and off as truth values and quoted numbers as text; pydantic takes both for
        numbers.
        """
        for name, value in data.items() if isinstance(data, dict) else ():
            field = cls.model_fields.get(name)
            values = value if isinstance(value, list | tuple) else [value]
            kinds = _leaves(field.annotation) if field else {bool, str}
            if bool not in kinds and any(isinstance(each, bool) for each in values):
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
_MOST_SHOWN_KEYS = 8  # keys named in an error


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
    """`data` as settings; a mistake names `where`, the line where known, the place, the value and what was
    expected.

    Relative paths in it count from `directory`.
    """
    try:
        return kind.model_validate(data, context={"directory": directory})
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise ConfigurationError(_describe(first, kind, where, lines or {}, data)) from error


def beside_the_file(path: Path, info: ValidationInfo) -> Path:
    """A relative path counts from the folder of the settings file, which the validation context names.

    Absolute, for effective settings that are printed may be read from elsewhere.
    """
    return (Path((info.context or {}).get("directory", "")) / path).absolute()


def _describe(
    problem: ErrorDetails, kind: type[BaseModel], where: str, lines: dict[Place, int], data: object
) -> str:
    place, value = _placed(problem["loc"], lines), problem["input"]
    line = _line(place, lines)
    dotted = "".join(f"[{p}]" if isinstance(p, int) else f".{shown_key(p)}" for p in place).lstrip(".")
    dotted = dotted or _WHOLE
    expected = problem["msg"].removeprefix("Value error, ")
    match problem["type"]:
        case "extra_forbidden":
            return (
                f"{where}{line}: {dotted}: unknown key, expected {_expected_keys(kind, problem['loc'], data)}"
            )
        case "missing":
            return f"{where}{line}: {dotted}: missing, a value is required"
        case "union_tag_invalid" | "union_tag_not_found":
            return _describe_kind(problem["ctx"], where, place, dotted, lines)
    if isinstance(value, dict) and problem["type"] == "value_error":  # a rule over several values names them
        line = _line((*place, *re.split(r"[ :]", expected)[0].split(".")), lines)
        return f"{where}{line}: {'' if dotted == _WHOLE else f'{dotted}: '}{expected}"
    simple = isinstance(value, int | float | str | bool | None)
    shown = repr(value) if simple else KINDS.get(type(value), "a mapping")
    return f"{where}{line}: {dotted} = {shown}: {expected[:1].lower()}{expected[1:]}"


def _describe_kind(
    found: dict[str, Any], where: str, place: Place, dotted: str, lines: dict[Place, int]
) -> str:
    """The key that tells which of several kinds of section stands at a place is unknown or missing."""
    key = str(found["discriminator"]).strip("'")
    head = f"{where}{_line((*place, key), lines)}: {dotted}.{key}"
    if "tag" not in found:
        return f"{head}: missing, a value is required"
    return f"{head} = {shown_key(str(found['tag']))!r}: expected one of {found['expected_tags']}"


def _leaves(annotation: Any) -> set[Any]:  # noqa: ANN401 - any type expression
    """The types and literals that an annotation is made of: `tuple[float, int] | None` has three."""
    inside = [leaf for part in get_args(annotation) for leaf in _leaves(part)]
    return set(inside) if inside else {annotation}


def _expected_keys(kind: type[BaseModel], place: tuple[int | str, ...], data: object = None) -> str:
    """What may stand where an unknown key does: the one that it resembles, or those there are.

    `data`: what was read; its `driver` tells which settings are meant.
    """
    models: list[type[BaseModel]] = [kind]
    for part in place[:-1]:
        models = models if isinstance(part, int) else _below(models, part)
        data = _inside(data, part)
        if isinstance(data, dict) and "driver" in data:
            models = [each for model in models for each in _derived(model, data["driver"])] or models
    known = sorted({name for model in models for name in model.model_fields})
    close = get_close_matches(str(place[-1]), known, n=1)
    more = ", ..." if len(known) > _MOST_SHOWN_KEYS else ""
    return close[0] if close else f"one of {', '.join(known[:_MOST_SHOWN_KEYS])}{more}"


def _below(models: list[type[BaseModel]], name: str) -> list[type[BaseModel]]:
    """The models that a field holds; `name` may be the tag of a union's member, too."""
    found = [model.model_fields[name].annotation for model in models if name in model.model_fields]
    if found:
        return _models(found)
    return [model for model in models if name in _literals(model)] or models


def _inside(data: Any, part: int | str) -> Any:  # noqa: ANN401 - whatever was read
    try:
        return data[part]
    except (KeyError, IndexError, TypeError):
        return None


def _derived(model: type[BaseModel], driver: object) -> list[type[BaseModel]]:
    """The model and what derives from it, of those whose `driver` may be that name."""
    below = [found for each in model.__subclasses__() for found in _derived(each, driver)]
    return [*below, model] if driver in _literals(model) else below


def _models(annotations: Iterable[Any]) -> list[type[BaseModel]]:
    each = (leaf for annotation in annotations for leaf in _leaves(annotation))
    return [leaf for leaf in each if isinstance(leaf, type) and issubclass(leaf, BaseModel)]


def _literals(model: type[BaseModel]) -> set[Any]:
    return {leaf for field in model.model_fields.values() for leaf in get_args(field.annotation)}


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
    """`base` with the values of `override` laid over it, mapping by mapping."""
    merged = dict(base)
    for key, value in override.items():
        both = isinstance(value, dict) and isinstance(merged.get(key), dict)
        merged[key] = deep_merge(merged[key], value) if both else value
    return merged
