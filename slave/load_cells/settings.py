"""Which driver reads the force, and what it has to know."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from forefeel.common.config import Settings
from forefeel.common.hardware.ascii_line import NEWTON_PER_UNIT, Unit
from forefeel.common.hardware.calibration import CellScale, Serial
from forefeel.common.hardware.settings import CanSettings, SerialSettings, Sign
from forefeel.common.messages import MOST_FORCE_N
from forefeel.common.settings import ColumnSettings, ExistingFile

FullScale = Annotated[float, Field(gt=0.0, le=MOST_FORCE_N)]
Native = Annotated[float, Field(gt=0.0, le=1e12)]
"""What the device's number rises by from no load to `full_scale_n`, by its data sheet."""


class SimulatedLoadCellDriver(Settings):
    """The load cell of the axis' simulated world."""

    driver: Literal["simulated"] = "simulated"


class RecordedLoadCellDriver(Settings):
    """The force of `recording` at each command's recording time, times `force_sign`: -1 for a recording that
    shows the reaction to the resisting force.
    """

    driver: Literal["recorded"]
    recording: ExistingFile
    columns: ColumnSettings | None = None
    force_sign: Sign = 1


class BotaSettings(SerialSettings):
    """A Bota six-axis cell that streams binary frames; `component`: the one along the instrument."""

    driver: Literal["bota_serial"]
    baud: Annotated[int, Field(ge=9600, le=12_000_000)] = 460_800
    component: Literal["fx", "fy", "fz"] = "fz"
    sign: Sign = 1
    full_scale_n: FullScale
    rate_hz: Annotated[float, Field(ge=1, le=2000)] = 800.0
    serial: Serial | None = None
    calibration: ExistingFile | None = None

    @property
    def scale(self) -> CellScale:
        """It gives newtons."""
        return CellScale(1.0, self.full_scale_n)


class AsciiLineSettings(SerialSettings):
    """A load cell that prints one number a line: `newton`, `millipound_force` (Loadstar) or `counts` (HX711).

    `request`: what asks for a reading (Loadstar: `O0W1`) or begins a stream of them (`O0W0`), without the
    carriage return; null when the cell streams by itself. Counts need a calibration, and
    `full_scale_native`: by how many the reading rises from no load to `full_scale_n`, by the data sheets.
    """

    driver: Literal["ascii_line"]
    baud: Annotated[int, Field(ge=300, le=12_000_000)] = 9600
    unit: Unit = "newton"
    request: Annotated[str, Field(max_length=32)] | None = None
    sign: Sign = 1
    full_scale_n: FullScale
    full_scale_native: Native | None = None
    rate_hz: Annotated[float, Field(ge=1, le=2000)] = 80.0
    serial: Serial | None = None
    calibration: ExistingFile | None = None

    @model_validator(mode="after")
    def _scale_is_known_once(self) -> Self:
        if (self.unit == "counts") is (self.full_scale_native is None):
            expected = "the counts at full_scale_n" if self.unit == "counts" else "none, for the unit tells"
            raise ValueError(
                f"full_scale_native = {self.full_scale_native} with unit = {self.unit!r}: expected {expected}"
            )
        return self

    @property
    def scale(self) -> CellScale:
        """By the unit; of counts by `full_scale_native`."""
        newton_per_native = NEWTON_PER_UNIT.get(self.unit)
        if newton_per_native is None:
            assert self.full_scale_native is not None, "_scale_is_known_once refuses it"
            newton_per_native = self.full_scale_n / self.full_scale_native
        return CellScale(newton_per_native, self.full_scale_n)


class Cia404Settings(Settings):
    """A CiA 404 force transducer: process value (REAL32, N) and status in one TPDO at every SYNC.

    `full_scale_native`: what the process value rises by from no load to `full_scale_n`, for a device whose
    unit is none of force; such a one needs a calibration, too.
    """

    driver: Literal["cia404"]
    can: CanSettings
    node_id: Annotated[int, Field(ge=1, le=127)]
    sign: Sign = 1
    full_scale_n: FullScale
    full_scale_native: Native | None = None
    rate_hz: Annotated[float, Field(ge=1, le=1000)] = 250.0
    calibration: ExistingFile | None = None

    @property
    def scale(self) -> CellScale | None:
        """By `full_scale_native`; None: the device tells."""
        native = self.full_scale_native
        return None if native is None else CellScale(self.full_scale_n / native, self.full_scale_n)


LoadCellDriver = Annotated[
    SimulatedLoadCellDriver | RecordedLoadCellDriver | BotaSettings | AsciiLineSettings | Cia404Settings,
    Field(discriminator="driver"),
]
