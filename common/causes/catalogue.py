"""Every form of a cause that a diagnosis can name: our own and those of installed effects.

A force effect of another distribution (entry points of the group `forefeel.effects`) is tried like ours.
Installed effects on motion, contact or reading are not searched: they would change all other columns.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress

from forefeel.common.causes.base import Effect, ForceEffect
from forefeel.common.causes.candidate import Candidate, base_name, form_name
from forefeel.common.causes.generic import MOST_SHAPES, GenericForce
from forefeel.common.causes.registry import OWN, effect_class, effect_names


def kin(name: str) -> str:
    """Part of a bench that a cause describes, by the name of a form; the cause's name if it sets no `kin`."""
    return cause_class(name).kin or base_name(name)


def no_rivals(name: str) -> set[str]:
    """Names of the causes that describe the same part of a bench as a form, or dry friction as it does."""
    rubs, thing = cause_class(name).rubs, kin(name)
    return {base_name(n) for n in CANDIDATES if kin(n) == thing or (rubs and cause_class(n).rubs)}


def cause_class(name: str) -> type[Effect]:
    """Class of a cause, by the name of a form; plain `Effect`, with its defaults, for an unknown name."""
    known = base_name(name)
    return effect_class(known) if known in OWN or known in CANDIDATES else Effect


def _forms(kind: type[Effect]) -> Iterator[tuple[str, Candidate]]:
    for candidate in kind.candidates:
        yield form_name(kind.name, candidate.form), candidate.of(kind)


CANDIDATES: dict[str, Candidate] = {
    name: candidate for kind in OWN.values() for name, candidate in _forms(kind)
}


def refresh(report: Callable[[str], None] = lambda line: None) -> None:
    """Adds to CANDIDATES the effects that are installed now, removes those that no longer are.

    Args:
        report: gets one line for each installed effect that can not be searched.
    """
    installed = dict(_installed(report))
    for name in [name for name in CANDIDATES if base_name(name) not in OWN and name not in installed]:
        del CANDIDATES[name]
    CANDIDATES.update(installed)


def words(name: str, column: str = "") -> str:
    """Name of a cause in everyday words, by the name of a form; by default that name, without underscores."""
    text = cause_class(name).words or name.replace("_", " ")
    return text.format(column=column or "another column")


def equation(name: str, parameters: Mapping[str, float]) -> tuple[bool, str]:
    """Returns (True if the cause adds a force, its equation with the numbers of the parameters in it).

    `name`: of a form. Takes the first equation whose parameters are all given; without one it returns (False,
    the cause's name in everyday words).
    """
    kind = cause_class(name)
    values = {key: f"{value:.3g}" for key, value in parameters.items()}
    for text in kind.equation:
        with suppress(KeyError):
            return issubclass(kind, ForceEffect), text.format_map(values)
    return False, words(name)


def _installed(report: Callable[[str], None]) -> Iterator[tuple[str, Candidate]]:
    """Yields (name, form) of every effect of other distributions that a diagnosis can search; loads them.

    `report` gets one line for each effect that it leaves out: one that fails to load, or that declares no
    form and adds no force or has more than `MOST_SHAPES` parameters that are not linear.
    """
    for name in effect_names():
        if name in OWN:
            continue
        try:
            kind = effect_class(name)
        except ValueError as error:
            report(f"not searched: {error}")
            continue
        if kind.candidates:
            yield from _forms(kind)
        elif not issubclass(kind, ForceEffect):
            report(f"not searched: {name} adds no force")
        elif len(kind.shape_names()) > MOST_SHAPES:
            report(f"not searched: {name} has {len(kind.shape_names())} parameters that are not linear")
        else:
            yield name, GenericForce().of(kind)
