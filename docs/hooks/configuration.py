"""The page of every setting: where it stands, its unit, what it may hold, its default. From the models."""

from collections import defaultdict
from collections.abc import Mapping
from typing import Any, get_args

from pydantic import BaseModel

from docs.hooks.markdown import NOTE, code, prose, table
from docs.hooks.units import unit_of
from docs.hooks.values import default, models, values
from forefeel.common.hardware.calibration import LoadCellCalibration, StageCalibration
from forefeel.common.transport.settings import PRESETS as IMPAIRMENTS
from forefeel.loopback.plan import WorldFile
from forefeel.master.settings import MasterSettings
from forefeel.network_settings import ObserverSettings, RouterSettings
from forefeel.report.vessel import VesselSettings
from forefeel.slave.plant.presets import PRESETS as WORLDS
from forefeel.slave.settings import SlaveSettings

ROOTS: dict[str, type[BaseModel]] = {
    "The slave's file": SlaveSettings,
    "The master's file": MasterSettings,
    "The recorder's and the viewer's file": ObserverSettings,
    "The router's file": RouterSettings,
    "The vessel on the page": VesselSettings,
    "The world of `loopback --world`": WorldFile,
    "The calibration of a load cell": LoadCellCalibration,
    "The calibration of a stage": StageCalibration,
}
_HEAD = f"""{NOTE}
# Configuration

Every setting, from the models that read the files. `forefeel config check FILE` prints the effective settings
of a file, defaults included, or one line that says what is wrong. Units are SI; a name ends in its unit.
Unknown keys, quoted numbers, NaN and infinity are refused. Each daemon's file says its `role`. A path counts
from the folder of the file that names it. `[]` stands for each entry of a list.

> Research software, not a medical device.
"""


def page() -> str:
    """The page as Markdown."""
    places, sections = _places(), []
    seen: set[type[BaseModel]] = set()
    for title, root in ROOTS.items():
        sections.append(f"## {title} {{ #{root.__name__} }}\n\n{_body(root)}")
        for kind in _below(root):
            if kind not in seen:
                seen.add(kind)
                sections.append(_section(kind, places[kind]))
    return "\n".join([_HEAD, *sections, _worlds(), _impairments()])


def link(kind: type) -> str:
    """To the section of those settings."""
    driver = _tag(kind)
    return f"[{driver or kind.__name__}](#{kind.__name__})"


def _section(kind: type[BaseModel], places: list[str]) -> str:
    driver, (first, *others) = _tag(kind), places
    title = f"{code(first)} with `driver: {driver}`" if driver else code(first)
    also = f"Also at {', '.join(map(code, others))}.\n\n" if others else ""
    return f"### {title} {{ #{kind.__name__} }}\n\n{also}{_body(kind)}"


def _body(kind: type[BaseModel]) -> str:
    rows = [
        [code(name), unit_of(name), values(field.annotation, field.metadata, link), default(field)]
        for name, field in kind.model_fields.items()
    ]
    return f"{prose(kind.__doc__)}\n\n{table(['setting', 'unit', 'values', 'default'], rows)}"


def _tag(kind: type) -> str:
    field = kind.model_fields.get("driver") if issubclass(kind, BaseModel) else None
    return str(next(iter(get_args(field.annotation)), "")) if field else ""


def _places() -> dict[type[BaseModel], list[str]]:
    """Where each section may stand, in any file, the first first."""
    found: dict[type[BaseModel], list[str]] = defaultdict(list)
    for root in ROOTS.values():
        for kind, place in _walk(root, ""):
            if place not in found[kind]:
                found[kind].append(place)
    return found


def _below(root: type[BaseModel]) -> list[type[BaseModel]]:
    return [kind for kind, _ in _walk(root, "")]


def _walk(kind: type[BaseModel], place: str) -> list[tuple[type[BaseModel], str]]:
    found = []
    for name, field in kind.model_fields.items():
        listed = "[]" if str(field.annotation).startswith("tuple[") else ""
        for each in models(field.annotation):
            at = f"{place}{name}{listed}"
            found += [(each, at), *_walk(each, f"{at}.")]
    return found


def _worlds() -> str:
    """What the presets of the simulated world hold, value by value."""
    flat = {name: dict(_leaves(values, "")) for name, values in WORLDS.items()}
    rows = [[code(key), *(code(world[key]) for world in flat.values())] for key in next(iter(flat.values()))]
    head = "## Presets of the simulated world { #presets-of-the-simulated-world }\n\n"
    return f"{head}What a preset does not name has the default above.\n\n{table(['setting', *flat], rows)}"


def _leaves(mapping: Mapping[str, Any], place: str) -> list[tuple[str, Any]]:
    found: list[tuple[str, Any]] = []
    for key, value in mapping.items():
        if isinstance(value, Mapping):
            found += _leaves(value, f"{place}{key}.")
        elif key == "effects":
            found.append((f"{place}{key}", ", ".join(each["effect"] for each in value)))
        else:
            found.append((f"{place}{key}", value))
    return found


def _impairments() -> str:
    names = list(next(iter(IMPAIRMENTS.values())).model_dump())
    rows = [[code(name), *(f"{getattr(each, key):g}" for key in names)] for name, each in IMPAIRMENTS.items()]
    head = "## Presets of the impairment { #presets-of-the-impairment }\n\nOne way.\n\n"
    return head + table(["preset", *map(code, names)], rows)
