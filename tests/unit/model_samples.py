"""Models of causes as a test writes them."""

from typing import Any

from forefeel.common.causes.model import SCHEMA, ContactModel


def effect(name: str, site: str = "", /, **parameters: float) -> dict[str, Any]:
    """An entry of a model, at the effect's own site unless one is given."""
    return {"effect": name, "parameters": parameters, **({"site": site} if site else {})}


def mapping(*effects: dict[str, Any]) -> dict[str, Any]:
    return {"schema": SCHEMA, "name": "test", "effects": list(effects)}


def model(*effects: dict[str, Any]) -> ContactModel:
    return ContactModel.from_mapping(mapping(*effects))
