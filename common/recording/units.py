"""Units of imported columns, each with its factor to SI, and the text `unit:column` that names both."""

from dataclasses import dataclass
from math import inf, isclose, pi
from typing import Any, Literal, get_args

from forefeel.common.errors import RecordingError

Quantity = Literal["time", "position", "force"]
QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)

TO_SI: dict[Quantity, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    "position": {
        "m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9, "in": 0.0254, "rad": 1.0, "deg": pi / 180.0,
        "turn": 2.0 * pi,
    },
    "force": {
        "N": 1.0, "mN": 1e-3, "uN": 1e-6, "kN": 1e3, "gf": 9.80665e-3, "kgf": 9.80665, "lbf": 4.4482216152605,
        "kip": 4448.2216152605, "MN": 1e6, "Nm": 1.0, "mNm": 1e-3, "Ncm": 1e-2, "Nmm": 1e-3,
    },
}  # fmt: skip
"""For a rotation rad stand for m, and N m for N."""
_OTHER_WORDS: dict[Quantity, dict[str, str]] = {
    "time": {
        "sec": "s", "secs": "s", "second": "s", "seconds": "s", "sek": "s", "msec": "ms", "millis": "ms",
        "milliseconds": "ms", "microseconds": "us", "nanoseconds": "ns", "minutes": "min", "micros": "us",
        "с": "s", "мс": "ms", "秒": "s",
    },
    "position": {
        "meter": "m", "meters": "m", "metre": "m", "millimeter": "mm", "millimeters": "mm", "micron": "um",
        "microns": "um", "inch": "in", "inches": "in", "radian": "rad", "radians": "rad", "degree": "deg",
        "degrees": "deg", "°": "deg", "turns": "turn", "м": "m", "мм": "mm",
    },
    "force": {"newton": "N", "newtons": "N", "g": "gf", "kg": "kgf", "lb": "lbf", "lbs": "lbf", "н": "N",
        "кн": "kN",
    },
}  # fmt: skip


def unit_of(quantity: Quantity, text: str) -> str | None:
    """The unit that a word stands for, such as `(sec)`, `µm`, `N·m`; None: no unit of the quantity."""
    word = text.strip(" []()").replace("µ", "u").replace("μ", "u")
    word = "".join(letter for letter in word if letter not in "·*-. ")
    units = {unit.lower(): unit for unit in reversed(TO_SI[quantity])}
    exact = word if word in TO_SI[quantity] else None
    if word != word.lower() and any(word in of_any for of_any in TO_SI.values()):
        return exact  # Nm are no nm
    return exact or _OTHER_WORDS[quantity].get(word.lower()) or units.get(word.lower())


_ANGLES = {"rad", "deg", "turn"}
_TORQUES = {"Nm", "mNm", "Ncm", "Nmm"}
_TEMPERATURES = {"K", "kelvin", "degC", "°C", "celsius"}


def is_angle(column: str) -> bool:
    """True if the unit of a `unit:column` is one of an angle."""
    return column.partition(":")[0] in _ANGLES


def si_of(quantity: Quantity, unit: str) -> str:
    """SI unit of a position (m, rad), a force (N, N m) or a time (s) in that unit."""
    if quantity == "position":
        return "rad" if unit in _ANGLES else "m"
    return "s" if quantity == "time" else "N m" if unit in _TORQUES else "N"


def is_temperature(text: str) -> bool:
    return text.strip(" []()") in _TEMPERATURES


def parse_column(quantity: Quantity, text: str) -> tuple[str, str]:
    """The column's name and its unit, from e.g. `mm:laser`; the name may itself hold colons.

    Raises:
        RecordingError: no unit, no name, or a unit that the quantity does not have.
    """
    unit, _, column = (part.strip() for part in text.partition(":"))
    if not column:
        raise RecordingError(
            f"{quantity} = {text!r}: expected unit:column, e.g. {next(iter(TO_SI[quantity]))}:name"
        )
    if (known := unit_of(quantity, unit)) is None:
        raise RecordingError(
            f"{quantity} = {text!r}: unknown unit {unit!r}, expected {', '.join(TO_SI[quantity])}"
        )
    return column, known


def rescaled(quantity: Quantity, unit: str, factor: float) -> str | None:
    """The unit that is `factor` times as large; None: there is none."""
    wanted = factor * TO_SI[quantity][unit]
    return next((name for name, to_si in TO_SI[quantity].items() if isclose(to_si, wanted)), None)


@dataclass(frozen=True, slots=True)
class Mapping:
    """Columns of time, position and force, each as `unit:column`, e.g. `mm:laser`; None: as their names say.
    `rate_hz`: of the rows of a table in which no column has their time.

    Raises:
        RecordingError: see `parse_column`; a rate that is none, or a time beside it.
    """

    time: str | None = None
    position: str | None = None
    force: str | None = None
    rate_hz: float | None = None

    def __post_init__(self) -> None:
        self.columns()
        if self.rate_hz is not None and not (0.0 < self.rate_hz < inf and self.time is None):
            raise RecordingError(
                f"rate = {self.rate_hz:g}: expected a rate in Hz, and no time column beside it"
            )

    def options(self) -> dict[str, Any]:
        """Names and values of the command line's options for it."""
        return {"time": self.time, "position": self.position, "force": self.force, "rate": self.rate_hz}

    def columns(self) -> dict[Quantity, tuple[str, str]]:
        """(column, unit) of what is given."""
        given = zip(QUANTITIES, (self.time, self.position, self.force), strict=True)
        return {quantity: parse_column(quantity, text) for quantity, text in given if text is not None}
