"""Columns of time, position and force in a table, and their units, by the words that people use."""

import re
from collections.abc import Mapping as NamedUnits
from collections.abc import Sequence
from dataclasses import dataclass

from forefeel.common.recording.units import QUANTITIES, TO_SI, Quantity, is_temperature, si_of, unit_of

_ANGLE, _TORQUE = "q|angle|theta|winkel", "[a-z]?torque|tau|moment|drehmoment"
_WORDS: dict[Quantity, str] = {
    "time": "time|t|tout|timestamp|stamp|zeit|zeitstempel|elapsed|temps|tiempo|tempo|seconds|clock",
    "position": "position|pos|displacement|displ?|stroke|travel|extension|elongation|depth|indentation"
    "|insertion|deflection|compression|dist|distance|crosshead|weg|hub|deplacement|allongement|d|x"
    f"|{_ANGLE}",
    "force": f"force|forc|load|kraft|last|tension|f|fx|fy|fz|loadcell|effort|wrench|{_TORQUE}",
}


def _any_of(words: str) -> re.Pattern[str]:
    """One of them, with no letter beside it."""
    return re.compile(rf"(?:^|[^a-z])(?:{words})(?:[^a-z]|$)")


_PATTERNS = {quantity: _any_of(words) for quantity, words in _WORDS.items()}
_ROTARY = _any_of(f"{_ANGLE}|[a-z]q|{_TORQUE}")
_DERIVATIVE = _any_of("[a-z]?d{1,2}[qx]|vel|velocity|speed|acc|acceleration|dot")
"""Speed and acceleration, which are none of the three; `v` and `a` are where they are the whole name."""
_BRACKETED = re.compile(r"(.*?)[\s_]*[\[(]([^\])]*)[\])]\s*")
_SUFFIXED = re.compile(r"(.*?)(?:_|\s+in\s+|\s*/\s*|\s*,\s*|\s+)([^\s_/,]+)\s*")
_PATTERNS_OF_UNIT = _BRACKETED, _SUFFIXED
_CANONICAL: dict[Quantity, str] = {"time": "time_s", "position": "position_m", "force": "force_n"}


@dataclass(frozen=True, slots=True)
class Choice:
    """A column that may hold the quantity; `unit`: None where nothing states it."""

    column: str
    unit: str | None


def candidates(names: Sequence[str], units: NamedUnits[str, str], quantity: Quantity) -> list[Choice]:
    """Columns whose name speaks of the quantity and of no derivative; the canonical name, such as `time_s`,
    alone where it is there. Those without a unit only where none has one. `units`: of the file, by column.
    """
    canonical = _CANONICAL[quantity]
    if canonical in names:
        return [Choice(canonical, canonical.partition("_")[2].replace("n", "N"))]
    choices = []
    for name in names:
        bare, unit = split_unit(name, quantity)
        unit = unit_of(quantity, units.get(name, "")) or unit
        other = unit is None and quantity == "position" and _PATTERNS["force"].search(bare.lower())
        if _PATTERNS[quantity].search(bare.lower()) and not other and not is_derivative(bare):
            choices.append(Choice(name, unit))
    return [choice for choice in choices if choice.unit is not None] or choices


def undecided(names: Sequence[str], units: NamedUnits[str, str], quantity: Quantity) -> list[Choice]:
    """Columns that may hold the quantity: their names have no unit of another one, and are no derivative.
    `units`: of the file, by column; the choice has its unit from there alone, or None.
    """
    others = [other for other in QUANTITIES if other != quantity]
    return [
        Choice(name, unit_of(quantity, units.get(name, "")))
        for name in names
        if not is_derivative(name) and not any(split_unit(name, other)[1] for other in others)
    ]


def further(names: Sequence[str], units: NamedUnits[str, str]) -> list[tuple[str, str, float]]:
    """(column, SI unit, factor to it) of each that states a unit of length, angle, force, torque or
    temperature (taken for Celsius: no force has to do with its zero), and is no derivative.
    """
    stated = []
    for name in names:
        if is_derivative(name):
            continue
        for quantity in QUANTITIES[1:]:
            unit = unit_of(quantity, units.get(name, "")) or split_unit(name, quantity)[1]
            if unit is not None:
                stated.append((name, si_of(quantity, unit), TO_SI[quantity][unit]))
                break
        else:
            parts = [units.get(name, ""), *(m[2] for p in _PATTERNS_OF_UNIT if (m := p.fullmatch(name)))]
            if any(map(is_temperature, parts)):
                stated.append((name, "degC", 1.0))
    return stated


def is_derivative(name: str) -> bool:
    return name.lower() in {"v", "a"} or _DERIVATIVE.search(name.lower()) is not None


def is_rotary(name: str) -> bool:
    """True if it speaks of an angle or a torque."""
    return _ROTARY.search(name.lower()) is not None


def split_unit(name: str, quantity: Quantity) -> tuple[str, str | None]:
    """`Force (mN)`, `force_mn`, `F / mN`: (force, mN); None: it names no unit of the quantity."""
    for pattern in _PATTERNS_OF_UNIT:
        match = pattern.fullmatch(name)
        if match is not None and (unit := unit_of(quantity, match[2])) is not None:
            return match[1], unit
    return name, None
