"""YAML settings of a Bota six-axis cell."""

from typing import Annotated, Literal

from pydantic import Field

from forefeel.devices.shared.settings import SerialCellSettings


class BotaSettings(SerialCellSettings):
    """A Bota six-axis cell that streams binary frames; `component`: the one along the instrument."""

    driver: Literal["bota_serial"]
    baud: Annotated[int, Field(ge=9600, le=12_000_000)] = 460_800
    component: Literal["fx", "fy", "fz"] = "fz"
    rate_hz: Annotated[float, Field(ge=1, le=2000)] = 800.0
