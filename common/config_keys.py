"""Which keys a settings model knows at a place, and which kinds of values a field takes."""

from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any, get_args

from pydantic import BaseModel

_MOST_SHOWN_KEYS = 8  # keys named in an error; chosen, not measured: with more the line is hard to read


def leaves(annotation: Any) -> set[Any]:  # noqa: ANN401 - any type expression
    """The types and literals that an annotation is made of: `tuple[float, int] | None` has three."""
    inside = [leaf for part in get_args(annotation) for leaf in leaves(part)]
    return set(inside) if inside else {annotation}


def expected_keys(kind: type[BaseModel], place: tuple[int | str, ...], data: object = None) -> str:
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
    each = (leaf for annotation in annotations for leaf in leaves(annotation))
    return [leaf for leaf in each if isinstance(leaf, type) and issubclass(leaf, BaseModel)]


def _literals(model: type[BaseModel]) -> set[Any]:
    return {leaf for field in model.model_fields.values() for leaf in get_args(field.annotation)}
