"""Units of imported columns, each with its factor to SI, and the text `unit:column` that names both."""

from typing import Literal

from common.errors import RecordingError

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
