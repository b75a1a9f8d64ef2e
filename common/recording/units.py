"""Units of imported columns, each with its factor to SI, and the text `unit:column` that names both."""

from dataclasses import dataclass
from math import isclose
from typing import Literal

from forefeel.common.errors import RecordingError

Quantity = Literal["time", "position", "force"]

TO_SI: dict[Quantity, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "position": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6},
    "force": {"N": 1.0, "mN": 1e-3, "kN": 1e3, "gf": 9.80665e-3, "kgf": 9.80665, "lbf": 4.4482216152605},
}


def parse_column(quantity: Quantity, text: str) -> tuple[str, float]:
    """The column's name and its factor to SI, from e.g. `mm:laser`; the name may itself hold colons.

    Raises:
        RecordingError: no unit, no name, or a unit that the quantity does not have.
    """
    unit, _, column = (part.strip() for part in text.partition(":"))
    if not column:
        raise RecordingError(
            f"{quantity} = {text!r}: expected unit:column, e.g. {next(iter(TO_SI[quantity]))}:name"
        )
    if unit not in TO_SI[quantity]:
        raise RecordingError(
            f"{quantity} = {text!r}: unknown unit {unit!r}, expected {', '.join(TO_SI[quantity])}"
        )
    return column, TO_SI[quantity][unit]


def rescaled(quantity: Quantity, text: str, factor: float) -> str | None:
    """`text`, e.g. `m:laser`, in the unit that is `factor` times as large; None: there is none."""
    column, to_si = parse_column(quantity, text)
    for unit, other in TO_SI[quantity].items():
        if isclose(other, factor * to_si):
            return f"{unit}:{column}"
    return None


@dataclass(frozen=True, slots=True)
class Mapping:
    """Which columns hold time, position and force (None: none does), each as `unit:column`, e.g. `mm:laser`.

    Raises:
        RecordingError: see `parse_column`.
    """

    time: str = "s:time_s"
    position: str = "m:position_m"
    force: str | None = None

    def __post_init__(self) -> None:
        self.columns()

    def columns(self) -> list[tuple[str, float]]:
        """(name, factor to SI) of time, position and, where mapped, force."""
        columns = [parse_column("time", self.time), parse_column("position", self.position)]
        return columns if self.force is None else [*columns, parse_column("force", self.force)]


NamedColumns = tuple[str | None, str | None, str | None]
"""Time, position, force on the command line, each as `unit:column`; None where the user named none."""


def mapping_of(columns: NamedColumns, force: str | None = "N:force_n") -> Mapping | None:
    """A mapping when the user named any column; the others have their canonical names. `force`: that of the
    force; None: not read.
    """
    if columns == (None, None, None):
        return None
    return Mapping(columns[0] or "s:time_s", columns[1] or "m:position_m", columns[2] or force)
