"""YAML -> frozen settings. Every mistake is one line: file, line, place, value, what was expected."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError, ValidationInfo, model_validator
from pydantic_core import ErrorDetails

from common.config_keys import expected_keys, leaves
from common.errors import ConfigurationError

Place = tuple[int | str, ...]


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
            kinds = leaves(field.annotation) if field else {bool, str}
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
_KINDS = {type(None): "empty", list: "a list", str: "text"}


class _AliasError(yaml.MarkedYAMLError):
    """An alias where a value should stand."""


class _Loader(yaml.SafeLoader):
    """Safe YAML that also reads 1e-3 as a number (YAML 1.2), as engineers write it.

    Without aliases: a few lines of them, each of the one before, stand for more than any memory holds.
    """

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:  # noqa: ANN401
        if self.check_event(yaml.AliasEvent):
            event = self.get_event()  # type: ignore[no-untyped-call]
            raise _AliasError(None, None, f"*{event.anchor} is an alias", event.start_mark)
        return super().compose_node(parent, index)


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(\d[\d_]*)(\.\d*)?[eE][-+]?\d+$"),
    list("-+0123456789"),
)


def load_yaml(path: Path) -> tuple[dict[str, Any], dict[Place, int]]:
    """The mapping in a YAML file, and the line of each place in it.

    Raises:
        ConfigurationError: missing, unreadable, not YAML, a key twice, or not a mapping.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise ConfigurationError(f"{path}: {reason}; expected a readable YAML file") from error
    try:
        loader = _Loader(text)
        node = loader.get_single_node()
        lines = dict(_lines(node, (), path)) if node else {}
        data = loader.construct_document(node) if node else None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = mark.line + 1 if mark else 1
        problem = getattr(error, "problem", None) or getattr(error, "reason", None) or "not YAML"
        expected = "the value itself" if isinstance(error, _AliasError) else "YAML"
        raise ConfigurationError(f"{path}:{line}: {problem}; expected {expected}") from error
    except (ValueError, RecursionError) as error:  # a date that is none; brackets a thousand deep
        raise ConfigurationError(f"{path}: {error}; expected YAML") from error
    if not isinstance(data, dict):
        found = _KINDS.get(type(data), f"{data!r:.40}")
        raise ConfigurationError(f"{path}:1: {found}; expected a mapping of settings")
    return data, lines


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
        raise ConfigurationError(_describe(first, kind, where, lines or {})) from error


def beside_the_file(path: Path, info: ValidationInfo) -> Path:
    """A relative path counts from the folder of the settings file, which the validation context names.

    Absolute, for effective settings that are printed may be read from elsewhere.
    """
    return (Path((info.context or {}).get("directory", "")) / path).absolute()


def _describe(problem: ErrorDetails, kind: type[BaseModel], where: str, lines: dict[Place, int]) -> str:
    place, value = _placed(problem["loc"], lines), problem["input"]
    line = _line(place, lines)
    dotted = "".join(f"[{p}]" if isinstance(p, int) else f".{_shown(p)}" for p in place).lstrip(".")
    dotted = dotted or _WHOLE
    expected = problem["msg"].removeprefix("Value error, ")
    match problem["type"]:
        case "extra_forbidden":
            return f"{where}{line}: {dotted}: unknown key, expected {expected_keys(kind, problem['loc'])}"
        case "missing":
            return f"{where}{line}: {dotted}: missing, a value is required"
        case "union_tag_invalid" | "union_tag_not_found":
            return _describe_kind(problem["ctx"], where, place, dotted, lines)
    if isinstance(value, dict) and problem["type"] == "value_error":  # a rule over several values names them
        line = _line((*place, *re.split(r"[ :]", expected)[0].split(".")), lines)
        return f"{where}{line}: {'' if dotted == _WHOLE else f'{dotted}: '}{expected}"
    simple = isinstance(value, int | float | str | bool | None)
    shown = repr(value) if simple else _KINDS.get(type(value), "a mapping")
    return f"{where}{line}: {dotted} = {shown}: {expected[:1].lower()}{expected[1:]}"


def _describe_kind(
    found: dict[str, Any], where: str, place: Place, dotted: str, lines: dict[Place, int]
) -> str:
    """The key that tells which of several kinds of section stands at a place is unknown or missing."""
    key = str(found["discriminator"]).strip("'")
    head = f"{where}{_line((*place, key), lines)}: {dotted}.{key}"
    if "tag" not in found:
        return f"{head}: missing, a value is required"
    return f"{head} = {_shown(str(found['tag']))!r}: expected one of {found['expected_tags']}"


def _line(place: Place, lines: dict[Place, int]) -> str:
    """The line of a place, or of the nearest around it that is known."""
    while place and place not in lines:
        place = place[:-1]
    return f":{lines[place]}" if place in lines else ""


def _shown(key: str) -> str:
    """A key on one line, whatever it holds."""
    return repr(key)[1:-1]


def _placed(loc: Place, lines: dict[Place, int]) -> Place:
    """`loc` as it stands in the file: without the names of union members that pydantic puts in between."""
    place: Place = ()
    for part in loc[:-1]:
        if not lines or (*place, part) in lines:
            place = (*place, part)
    return (*place, *loc[-1:])


def _lines(node: yaml.Node, place: Place, path: Path) -> Iterator[tuple[Place, int]]:
    yield place, node.start_mark.line + 1
    if isinstance(node, yaml.SequenceNode):
        for index, child in enumerate(node.value):
            yield from _lines(child, (*place, index), path)
    elif isinstance(node, yaml.MappingNode):
        seen: set[str] = set()
        for key, child in node.value:
            line = key.start_mark.line + 1
            if not isinstance(key, yaml.ScalarNode):
                raise ConfigurationError(f"{path}:{line}: a {key.id} as key; expected the name of a setting")
            if key.value in seen:
                raise ConfigurationError(
                    f"{path}:{line}: {_shown(key.value)}: the key stands twice; expected it once"
                )
            seen.add(key.value)
            yield from _lines(child, (*place, key.value), path)
            yield (*place, key.value), line


def dump_yaml(settings: BaseModel) -> str:
    """The effective settings as YAML, defaults included."""
    text: str = yaml.safe_dump(settings.model_dump(mode="json"), sort_keys=False, allow_unicode=True)
    return text


def deep_merge(base: dict[str, Any], override: dict[str, Any]) -> dict[str, Any]:
    """`base` with the values of `override` laid over it, mapping by mapping."""
    merged = dict(base)
    for key, value in override.items():
        both = isinstance(value, dict) and isinstance(merged.get(key), dict)
        merged[key] = deep_merge(merged[key], value) if both else value
    return merged


def dump_mapping(data: dict[str, Any]) -> str:
    """Plain data as YAML, in the order of its keys."""
    text: str = yaml.safe_dump(data, sort_keys=False, allow_unicode=True)
    return text
