"""Every cause that a diagnosis can name, by the name of its form: our own and those of installed effects.

A force effect of another distribution (entry points of the group `forefeel.effects`) is tried like ours.
Effects on motion, contact or reading of others are not searched: they would change the columns of all others.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress

from forefeel.common.causes.base import Effect, ForceEffect
from forefeel.common.causes.candidate import Candidate, Entry, Found, base_name
from forefeel.common.causes.generic import MOST_SHAPES, GenericForce
from forefeel.common.causes.registry import OWN, effect_class, effect_names

DRY = frozenset({"coulomb_friction", "stribeck_friction", "presliding_hysteresis"})
"""Descriptions of one and the same contact: a model holds at most one of them."""

FRICTION = DRY | {"position_dependent_friction", "capstan"}
"""Dry friction in any of its descriptions."""

LINEAR_BENDS = frozenset({"time_delay", "sensor_lag", "unmodelled_resonance"})
"""What turns and scales a force by its frequency."""

KIN = frozenset({"capstan", "position_dependent_friction"}), frozenset({"backlash", "play"})
"""Names for one and the same thing on a bench, told apart by details: none is another's rival."""


def kin(name: str) -> frozenset[str]:
    """The cause, and what is the same thing on a bench."""
    return next((names for names in KIN if name in names), frozenset({name}))


def _forms(kind: type[Effect]) -> Iterator[tuple[str, Candidate]]:
    for candidate in kind.candidates:
        yield f"{kind.name}:{candidate.form}" if candidate.form else kind.name, candidate.of(kind)


CANDIDATES: dict[str, Candidate] = {
    name: candidate for kind in OWN.values() for name, candidate in _forms(kind)
}


def refresh(said: Callable[[str], None] = lambda line: None) -> None:
    """Lets CANDIDATES know what is installed now, and nothing that no longer is.

    Args:
        said: hears in one line why an installed effect can not be searched.
    """
    found = dict(_installed(said))
    for name in [name for name in CANDIDATES if base_name(name) not in OWN and name not in found]:
        del CANDIDATES[name]
    CANDIDATES.update(found)


def entries(name: str, found: Found) -> list[Entry]:
    """What a model.yaml says of a cause, by the name of its form."""
    return CANDIDATES[name].entries(found)


def words(name: str) -> str:
    """A cause in everyday words; its name where its effect has none."""
    return _kind(name).words or name.replace("_", " ")


def equation(name: str, parameters: Mapping[str, float]) -> tuple[bool, str]:
    """Whether a cause adds a force, and its equation in numbers; its words where it has none of these."""
    kind = _kind(name)
    values = {key: f"{value:.3g}" for key, value in parameters.items()}
    for text in kind.equation:
        with suppress(KeyError):
            return issubclass(kind, ForceEffect), text.format_map(values)
    return False, words(name)


def fingerprint(name: str) -> str:
    """What a cause looks like in the residual; empty where its effect does not say."""
    return _kind(name).fingerprint


def remedy(name: str) -> str:
    """What a bench can do against a cause; empty where nothing is wrong with it."""
    return _kind(name).remedy


def _kind(name: str) -> type[Effect]:
    return effect_class(name) if name in OWN or name in CANDIDATES else Effect


def _installed(said: Callable[[str], None]) -> Iterator[tuple[str, Candidate]]:
    for name in effect_names():
        if name in OWN:
            continue
        try:
            kind = effect_class(name)
        except ValueError as error:
            said(f"not searched: {error}")
            continue
        if kind.candidates:
            yield from _forms(kind)
        elif not issubclass(kind, ForceEffect):
            said(f"not searched: {name} adds no force")
        elif len(kind.shape_names()) > MOST_SHAPES:
            said(f"not searched: {name} has {len(kind.shape_names())} parameters that are not linear")
        else:
            yield name, GenericForce().of(kind)
