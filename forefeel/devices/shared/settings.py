"""How a serial device is reached, and which way it counts."""

from typing import Annotated, Literal

from pydantic import Field

from forefeel.common.config import Settings

Sign = Literal[1, -1]
"""-1 where the device counts against the insertion."""


class SerialSettings(Settings):
    """A serial port: a device file, best by its stable name in /dev/serial/by-id."""

    port: Annotated[str, Field(min_length=1, max_length=4096)]
    baud: Annotated[int, Field(ge=300, le=12_000_000)] = 115_200
