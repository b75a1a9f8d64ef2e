"""YAML settings of a load cell that prints numbers."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from forefeel.common.hardware.calibration import CellScale
from forefeel.devices.ascii_line.protocol import NEWTON_PER_UNIT, Unit
from forefeel.devices.shared.settings import SerialCellSettings
from forefeel.slave.load_cell import Native


class AsciiLineSettings(SerialCellSettings):
    """A load cell that prints one number a line: `newton`, `millipound_force` (Loadstar) or `counts` (HX711).

    `request`: what asks for a reading (Loadstar: `O0W1`), without the carriage return; null when the cell
    streams by itself. Counts need a calibration, and `full_scale_native`: by how many the reading rises from
    no load to `full_scale_n`, by the data sheets.
    """

    driver: Literal["ascii_line"]
    baud: Annotated[int, Field(ge=300, le=12_000_000)] = 9600
    unit: Unit = "newton"
    request: Annotated[str, Field(max_length=32)] | None = None
    full_scale_native: Native | None = None
    rate_hz: Annotated[float, Field(ge=1, le=2000)] = 80.0

    @model_validator(mode="after")
    def _scale_is_known_once(self) -> Self:
        """Raises ValueError unless counts have a `full_scale_native`, and other units have none."""
        if (self.unit == "counts") is (self.full_scale_native is None):
            expected = "the counts at full_scale_n" if self.unit == "counts" else "none, for the unit tells"
            raise ValueError(
                f"full_scale_native = {self.full_scale_native} with unit = {self.unit!r}: expected {expected}"
            )
        return self

    @property
    def scale(self) -> CellScale:
        """The scale by the unit; of counts by `full_scale_native`."""
        newton_per_native = NEWTON_PER_UNIT.get(self.unit)
        if newton_per_native is None:
            assert self.full_scale_native is not None, "_scale_is_known_once refuses it"
            newton_per_native = self.full_scale_n / self.full_scale_native
        return CellScale(newton_per_native, self.full_scale_n)
