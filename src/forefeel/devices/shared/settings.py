"""Settings of a device's port or bus, and of its scale."""

from typing import Annotated, Literal

from pydantic import Field

from forefeel.common.config import Settings
from forefeel.common.hardware.calibration import CellScale, Serial
from forefeel.common.settings import ExistingFile
from forefeel.slave.load_cell import FullScale, LoadCellDriverSettings
from forefeel.slave.stage import StageDriverSettings, Travel

Sign = Literal[1, -1]  # -1 where the device counts against the insertion


class SerialSettings(Settings):
    """A serial port: a device file, best by its stable name in /dev/serial/by-id."""

    port: Annotated[str, Field(min_length=1, max_length=4096)]
    baud: Annotated[int, Field(ge=300, le=12_000_000)] = 115_200


class CanSettings(Settings):
    """A CAN bus as python-can opens it: `slcan` with a serial port, `socketcan` with `can0`, `virtual` within
    one process.
    """

    interface: Literal["slcan", "socketcan", "virtual"]
    channel: Annotated[str, Field(min_length=1, max_length=4096)]
    bitrate: Annotated[int, Field(ge=10_000, le=1_000_000)] = 1_000_000


NodeId = Annotated[int, Field(ge=1, le=126)]  # of a CANopen device; 127 is the host's heartbeat


class CellSettings(LoadCellDriverSettings):
    """Base of the settings of load cells with hardware."""

    sign: Sign = 1
    full_scale_n: FullScale
    calibration: ExistingFile | None = None


class SerialCellSettings(SerialSettings, CellSettings):
    """Base of the settings of load cells on a serial port. `rate_hz`: what the cell is set to; `serial`: the
    number on its label, where its port has none.
    """

    serial: Serial | None = None
    rate_hz: Annotated[float, Field(ge=1, le=2000)]

    @property
    def scale(self) -> CellScale:
        """By the data sheet."""
        return CellScale(1.0, self.full_scale_n)


class ScaledStageSettings(StageDriverSettings):
    """Base of the settings of stages that count. `travel_m`: where the stage may go."""

    sign: Sign = 1
    travel_m: Travel
    calibration: ExistingFile | None = None

    @property
    def native_per_m(self) -> float:
        """Microsteps or counts per metre."""
        raise NotImplementedError
