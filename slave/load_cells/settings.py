"""Which driver reads the force, and what it has to know."""

from typing import Annotated, Literal

from pydantic import Field

from common.config import Settings
from common.hardware.settings import CanSettings, SerialSettings, Sign
from common.settings import ColumnSettings, ExistingFile

FullScale = Annotated[float, Field(gt=0.0, le=10_000.0)]
Serial = Annotated[str, Field(min_length=1, max_length=64)]
"""What a calibration is bound to where the port has no serial number of its own (a UART on the board, an
adapter without): the number on the label of the device.
"""


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


class AsciiLineSettings(SerialSettings):
    """A load cell that prints one number a line: `newton`, `millipound_force` (Loadstar) or `counts` (HX711).

    `request`: what asks for a reading (Loadstar: `O0W1`) or begins a stream of them (`O0W0`), without the
    carriage return; null when the cell streams by itself. Counts need a calibration.
    """

    driver: Literal["ascii_line"]
    baud: Annotated[int, Field(ge=300, le=12_000_000)] = 9600
    unit: Literal["newton", "millipound_force", "counts"] = "newton"
    request: Annotated[str, Field(max_length=32)] | None = None
    sign: Sign = 1
    full_scale_n: FullScale
    rate_hz: Annotated[float, Field(ge=1, le=2000)] = 80.0
    serial: Serial | None = None
    calibration: ExistingFile | None = None


class Cia404Settings(Settings):
    """A CiA 404 force transducer: process value (REAL32, N) and status in one TPDO at every SYNC."""

    driver: Literal["cia404"]
    can: CanSettings
    node_id: Annotated[int, Field(ge=1, le=127)]
    sign: Sign = 1
    full_scale_n: FullScale
    rate_hz: Annotated[float, Field(ge=1, le=1000)] = 250.0
    calibration: ExistingFile | None = None


LoadCellDriver = Annotated[
    SimulatedLoadCellDriver | RecordedLoadCellDriver | BotaSettings | AsciiLineSettings | Cia404Settings,
    Field(discriminator="driver"),
]
