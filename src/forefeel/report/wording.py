"""Numbers in words: SI prefixes, no more digits than are known, a dash for what is not known."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import floor, isfinite, log10
from typing import TYPE_CHECKING

from forefeel.common.events.console import printable
from forefeel.common.events.text import PREFIXES, UNKNOWN, power_of_1000, quantity, shown_unit
from forefeel.common.messages import SafetyState

if TYPE_CHECKING:  # the diagnosis imports scipy, for which `forefeel loopback` would wait
    from forefeel.common.error_size import ErrorSize
    from forefeel.diagnosis.verdict import Interval
    from forefeel.report.model import AxisReport, SafetyNote

DISCLAIMER = "Research software, not a medical device."

_MASSES = {0: "kg", -1: "g", -2: "mg"}
_PREFIXED = {"N", "m", "s", "m/s", "N/s"}
_UNITS = {
    "_n_s2_m2": "N s²/m²",
    "_n_s_m2": "N s/m²",
    "_n_s_m": "N s/m",
    "_n_m3": "N/m³",
    "_n_m2": "N/m²",
    "_n_m": "N/m",
    "_n_s": "N/s",
    "_m_s": "m/s",
    "_rad_m": "rad/m",
    "_rad": "rad",
    "_kg": "kg",
    "_hz": "Hz",
    "_n": "N",
    "_m": "m",
    "_s": "s",
}
"""By the end of a parameter's name, the longest first."""
_PRODUCTS = {"euler_n_m2": ("euler", "N m²")}  # whose names end as a quotient's

_NAME = re.compile(r"\b[a-z]\w*\.\w+_\w+")  # of a parameter with its cause, in a text
_USUAL, _MOST = 3, 6  # digits of a value without an interval, and of any


def micros(value_us: float | None) -> str:
    return quantity(None if value_us is None else value_us * 1e-6, "s")


def share(value: float | None) -> str:
    """A share in per cent, never rounded up to 100."""
    if value is None:
        return UNKNOWN
    return f"{floor(value * 1000 + 1e-9) / 10:g} %"


def ratio(value: float | None) -> str:
    return UNKNOWN if value is None else f"{value:#.3g}".rstrip(".")


def fault_texts(events: Iterable["SafetyNote"]) -> list[str]:
    """A sentence for each reason of a fault of the slave, with its first time."""
    first: dict[str, float] = {}
    for event in events:
        if event.after == SafetyState.FAULT:
            first.setdefault(printable(event.reason), event.time_s)
    return [
        f"The slave stopped with a fault at {time_s:.1f} s: {reason}." for reason, time_s in first.items()
    ]


def felt_text(part: "AxisReport") -> str:
    """Text on the felt force: the share of the time in which its error is not felt, by the twin and as
    measured, and the error by the first of them that there is.
    """
    twin, measured = part.transparency, part.transparency_as_measured
    score = twin or measured
    if score is None:
        return "not judged: no command was answered, or the recording has no force scale"
    within = f"unnoticeable {share(score.within_jnd)} of the time"
    if measured is not None:
        within += " as measured" if twin is None else f", {share(measured.within_jnd)} as measured"
    return f"{within}; {error_text(score.felt, score.held, score.ratio)}"


def offset_text(offset_s: float | None) -> str:
    """A time offset in whole ms."""
    if offset_s is None:
        return UNKNOWN
    return f"{abs(1e3 * offset_s):.0f} ms {'early' if offset_s < 0.0 else 'late'}"


def error_text(size: "ErrorSize", late: "ErrorSize", times: float | None) -> str:
    return f"{quantity(size.rms_n, 'N')} rms, late {quantity(late.rms_n, 'N')} ({ratio(times)})"


def number(value: float | None) -> str:
    """An integer with thin gaps between the thousands, or a number with four digits."""
    if value is None:
        return UNKNOWN
    return (
        f"{value:,}".replace(",", "\N{NARROW NO-BREAK SPACE}") if isinstance(value, int) else f"{value:.4g}"
    )


def in_order(counts: Mapping[str, int]) -> str:
    """Numbers with their names, the largest first, without those that are zero."""
    return ", ".join(f"{n} {name}" for name, n in sorted(counts.items(), key=lambda item: -item[1]) if n)


@dataclass(frozen=True, slots=True)
class Shown:
    """Texts of a parameter."""

    label: str
    value: str
    interval: str
    unit: str

    def __str__(self) -> str:
        return f"{self.label} {self.value} {self.unit}".rstrip() + f" ({self.interval})"


def split_unit(name: str) -> tuple[str, str]:
    """(label, unit) of a parameter: `damping_n_s_m` is `damping` in `N s/m`; the unit may be empty."""
    if name in _PRODUCTS:
        return _PRODUCTS[name]
    for end, unit in _UNITS.items():
        if name.endswith(end) and len(name) > len(end):
            return name.removesuffix(end).replace("_", " "), unit
    return name.replace("_", " "), ""


def named(parameter: str) -> tuple[str, str]:
    """(label, unit) of `cause.parameter`: `heart.amplitude_n` is `heart: amplitude` in `N`.

    The paper's own three, of `mass_damper_spring`, need no cause.
    """
    cause, _, name = parameter.rpartition(".")
    label, unit = split_unit(name)
    return (label if cause in {"", "mass_damper_spring"} else f"{cause.replace('_', ' ')}: {label}"), unit


def statement_text(statement: str) -> str:
    """Text on parameters that the motion leaves undetermined, their names in words, also one that is cut."""
    return _NAME.sub(lambda name: named(name[0])[0], statement).replace("_", " ")


def scale(unit: str, largest: float) -> tuple[float, str]:
    """Factor, and unit with prefix, so that `largest` reads between 1 and 1000 where a prefix can do that;
    factor 1 for a unit that takes none, or where `largest` is not finite.
    """
    prefixed = {p: f"{word}{shown_unit(unit)}" for p, word in PREFIXES.items()}
    known = {p: shown_unit(word) for p, word in _MASSES.items()} if unit == "kg" else prefixed
    if (unit not in _PREFIXED and unit != "kg") or not isfinite(largest):
        return 1.0, shown_unit(unit)
    power = power_of_1000(largest, min(known))
    return 1000.0**-power, known[power]


def shown(name: str, interval: "Interval") -> Shown:
    """Texts of a parameter: the end of `name` gives the unit, the size of the value its prefix, the width of
    the interval the digits.
    """
    label, plain = split_unit(name)
    largest = interval.value or max(abs(interval.low), abs(interval.high))
    factor, unit = scale(plain, largest)
    value, low, high = (factor * x for x in (interval.value, interval.low, interval.high))
    places = _places(value, high - low)
    ends = f"{_fixed(low, places)} to {_fixed(high, places)}"
    return Shown(label, _fixed(value, places), ends, unit)


def plain_value(name: str, value: float) -> str:
    """Text of a parameter without interval, such as `20 g`; the end of `name` gives the unit."""
    unit = split_unit(name)[1]
    factor, prefixed = scale(unit, value)
    text = _fixed(factor * value, _places(factor * value, 0.0))
    if "." in text and "e" not in text:
        text = text.rstrip("0").rstrip(".")
    return f"{text} {prefixed}".rstrip()


def _places(value: float, width: float) -> int:
    """Places behind the point, for two digits of the interval's width and of the value; may be negative."""
    if not (isfinite(value) and isfinite(width)):
        return 0
    size = floor(log10(abs(value))) if value else 0
    by_width = 1 - floor(log10(width)) if width > 0.0 else _USUAL - 1 - size
    return min(max(by_width, 1 - size), _MOST - 1 - size)


def _fixed(value: float, places: int) -> str:
    """Text of a number with `places` behind the point, rounded to tens and more where negative; three digits
    below 1e-4 and from 1e6 on; `unknown` where it is not finite.
    """
    if not isfinite(value):
        return "unknown"
    rounded = round(value, places) + 0.0  # no minus zero
    if rounded and not 1e-4 <= abs(rounded) < 1e6:
        return f"{rounded:.3g}"
    return f"{rounded:.{max(0, places)}f}"
