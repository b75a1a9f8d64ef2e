"""What the YAML file says of the cell."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from forefeel.devices.shared.settings import Sign
from forefeel.slave.load_cell import FullScale, LoadCellDriverSettings


class IioSettings(LoadCellDriverSettings):
    """`file`: the raw value of the channel. `zero_counts`: of the unloaded cell."""

    driver: Literal["iio"]
    file: Path
    newton_per_count: Annotated[float, Field(gt=0, le=1)]
    zero_counts: float = 0.0
    sign: Sign = 1
    full_scale_n: FullScale
    rate_hz: Annotated[float, Field(ge=1, le=500)] = 80.0
