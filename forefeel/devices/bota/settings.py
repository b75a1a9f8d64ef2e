"""What the YAML file says of a Bota six-axis cell."""

from typing import Annotated, Literal

from pydantic import Field

from forefeel.common.hardware.calibration import CellScale, Serial
from forefeel.common.settings import ExistingFile
from forefeel.devices.shared.settings import SerialSettings, Sign
from forefeel.slave.load_cell import FullScale, LoadCellDriverSettings


class BotaSettings(SerialSettings, LoadCellDriverSettings):
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
        return CellScale(1.0, self.full_scale_n)
