"""What the YAML file says of a CiA 404 force transducer."""

from typing import Annotated, Literal

from pydantic import Field

from forefeel.common.hardware.calibration import CellScale
from forefeel.common.settings import ExistingFile
from forefeel.devices.shared.settings import CanSettings, NodeId, Sign
from forefeel.slave.load_cell import FullScale, LoadCellDriverSettings, Native


class Cia404Settings(LoadCellDriverSettings):
    """A CiA 404 force transducer: process value (REAL32, N) and status in one TPDO at every SYNC.

    `full_scale_native`: what the process value rises by from no load to `full_scale_n`, for a device whose
    unit is none of force; such a one needs a calibration, too.
    """

    driver: Literal["cia404"]
    can: CanSettings
    node_id: NodeId
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
