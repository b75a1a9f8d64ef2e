"""A contact model as data: which effects, with which parameters; what `model.yaml` holds."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast, get_args

from forefeel.common.causes.base import ContactEffect, Effect, ForceEffect, SensorEffect, Site
from forefeel.common.causes.column import WithColumn
from forefeel.common.causes.registry import effect_class
from forefeel.common.causes.runtime import ContactRuntime

SCHEMA = "forefeel.model/1"


@dataclass(frozen=True, slots=True)
class EffectEntry:
    """One effect of a model: its name, every parameter by name, and its site when not its own."""

    effect: str
    parameters: tuple[tuple[str, float], ...]
    site: Site | None = None
    column: str = ""

    def instance(self) -> Effect:
        effect = effect_class(self.effect)(**dict(self.parameters))
        if isinstance(effect, WithColumn):
            effect.column = self.column
        return effect

    def to_mapping(self) -> dict[str, object]:
        site = {} if self.site is None else {"site": self.site}
        column = {"column": self.column} if self.column else {}
        return {"effect": self.effect, **site, **column, "parameters": dict(self.parameters)}


@dataclass(frozen=True, slots=True)
class ContactModel:
    """An immutable list of effects; `runtime()` makes something that steps."""

    name: str
    effects: tuple[EffectEntry, ...]

    @classmethod
    def from_mapping(cls, mapping: object) -> "ContactModel":
        """The model that a plain mapping of schema `forefeel.model/1` describes, defaults filled in.

        Raises:
            ValueError: one line that names the place, such as `effects[2].parameters.width_m`.
        """
        fields = _fields(mapping, "model", required=("schema", "name", "effects"))
        if fields["schema"] != SCHEMA:
            raise ValueError(f"schema = {fields['schema']!r}: expected {SCHEMA!r}")
        name, effects = fields["name"], fields["effects"]
        if not isinstance(name, str) or not name:
            raise ValueError(f"name = {name!r}: expected a text")
        if not isinstance(effects, list | tuple):
            raise ValueError(f"effects = {effects!r}: expected a list")
        entries = tuple(_entry(entry, f"effects[{i}]") for i, entry in enumerate(effects))
        contacts = [i for i, e in enumerate(entries) if issubclass(effect_class(e.effect), ContactEffect)]
        if len(contacts) > 1:
            raise ValueError(f"effects[{contacts[1]}].effect: a second contact effect, expected at most one")
        return cls(name, entries)

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns that its effects follow beside the motion."""
        return tuple(dict.fromkeys(entry.column for entry in self.effects if entry.column))

    def to_mapping(self) -> dict[str, object]:
        effects = [entry.to_mapping() for entry in self.effects]
        return {"schema": SCHEMA, "name": self.name, "effects": effects}

    def runtime(self) -> ContactRuntime:
        return ContactRuntime([(entry.instance(), entry.site) for entry in self.effects])


def _mapping(value: object, place: str) -> Mapping[str, object]:
    if not isinstance(value, Mapping):
        raise ValueError(f"{place} = {value!r}: expected a mapping")
    return value


def _fields(
    value: object, place: str, required: tuple[str, ...], optional: tuple[str, ...] = ()
) -> Mapping[str, object]:
    """Returns a mapping with all required and no unknown keys. Raises ValueError, which names `place`."""
    fields, known = _mapping(value, place), required + optional
    for key in required:
        if key not in fields:
            raise ValueError(f"{place}: {key} is missing")
    for key in fields:
        if key not in known:
            raise ValueError(f"{place}: unknown key {key!r}, expected one of {', '.join(known)}")
    return fields


def _entry(value: object, place: str) -> EffectEntry:
    """Reads an entry of a model.yaml, defaults filled in. Raises ValueError, which names the place."""
    fields = _fields(value, place, required=("effect",), optional=("site", "column", "parameters"))
    kind = _kind(fields["effect"], f"{place}.effect")
    site = _checked_site(fields.get("site"), kind, f"{place}.site")
    where = f"{place}.parameters"
    given = _mapping(fields.get("parameters", {}), where)
    for key in given.keys() & {"site", "column"}:
        raise ValueError(f"{where}.{key}: no parameter, expected as {place}.{key}, beside parameters")
    parameters = kind.complete(given, where)
    column = fields.get("column", "")
    if issubclass(kind, WithColumn) != bool(column) or not isinstance(column, str):
        expected = "the name of a column" if issubclass(kind, WithColumn) else "none"
        raise ValueError(f"{place}.column = {column!r}: expected {expected}")
    return EffectEntry(kind.name, tuple(parameters.items()), site, column)


def _kind(name: object, place: str) -> type[Effect]:
    """Class of the effect of that name. Raises ValueError, which names `place`: no text, or no effect's."""
    if not isinstance(name, str):
        raise ValueError(f"{place} = {name!r}: expected a text")
    try:
        return effect_class(name)
    except ValueError as error:
        raise ValueError(f"{place}: {error}") from error


def _checked_site(site: object, kind: type[Effect], place: str) -> Site | None:
    """Returns `site` if it is a name of Site, or None. Raises ValueError, which names `place`: another value,
    or one for an effect that adds no force.
    """
    if site is None:
        return None
    if not issubclass(kind, ForceEffect):
        raise ValueError(f"{place} = {site!r}: {kind.name} adds no force, expected no site")
    if site in get_args(Site):
        return cast(Site, site)
    raise ValueError(f"{place} = {site!r}: expected one of {', '.join(get_args(Site))}")


def at_conversion(model: ContactModel) -> tuple[ContactModel, list[SensorEffect]]:
    """Splits a model: effects in continuous time, and sensor effects at each conversion, in their order.

    A linear sensor effect, such as a lag, acts in continuous time; one that rounds, clips or disturbs single
    readings does so when the load cell converts, and sees its noise.
    """
    continuous, converts = [], []
    for entry in model.effects:
        kind = effect_class(entry.effect)
        if issubclass(kind, SensorEffect) and not kind.linear:
            converts.append(kind(**dict(entry.parameters)))
        else:
            continuous.append(entry)
    return ContactModel(model.name, tuple(continuous)), converts
