"""Every cause that a diagnosis can name, by the name of its form: our own and those of installed effects.

A force effect of another distribution (entry points of the group `forefeel.effects`) is tried like ours.
Effects on motion, contact or reading of others are not searched: they would change the columns of all others.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress

from forefeel.common.causes.base import Effect, ForceEffect
from forefeel.common.causes.candidate import Candidate, base_name
from forefeel.common.causes.generic import MOST_SHAPES, GenericForce
from forefeel.common.causes.registry import OWN, effect_class, effect_names


def kin(name: str) -> str:
    """The thing on a bench that a cause describes, by the name of one of its forms."""
    return cause_class(name).kin or base_name(name)


def no_rivals(name: str) -> set[str]:
    """The causes that are no rivals of one: the same thing on a bench, as all kinds of dry friction are."""
    rubs, thing = cause_class(name).rubs, kin(name)
    return {base_name(n) for n in CANDIDATES if kin(n) == thing or (rubs and cause_class(n).rubs)}


def cause_class(name: str) -> type[Effect]:
    """The class of a cause, by the name of one of its forms; one without facts where it is not known."""
    known = base_name(name)
    return effect_class(known) if known in OWN or known in CANDIDATES else Effect


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


def words(name: str) -> str:
    """A cause in everyday words; its name where its effect has none."""
    return cause_class(name).words or name.replace("_", " ")


def equation(name: str, parameters: Mapping[str, float]) -> tuple[bool, str]:
    """Whether a cause adds a force, and its equation in numbers; its words where it has none of these."""
    kind = cause_class(name)
    values = {key: f"{value:.3g}" for key, value in parameters.items()}
    for text in kind.equation:
        with suppress(KeyError):
            return issubclass(kind, ForceEffect), text.format_map(values)
    return False, words(name)


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
