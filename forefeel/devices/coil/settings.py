"""YAML settings of a voice-coil handle."""

from typing import Annotated, Literal

from pydantic import Field

from forefeel.devices.shared.settings import SerialSettings, Sign
from forefeel.master.handle import HandleDriverSettings


class CoilSettings(SerialSettings, HandleDriverSettings):
    """A voice coil with an encoder behind a microcontroller: 1 kHz both ways, and a watchdog in the device.

    `newton_per_ampere`: of the coil; `max_current_a` bounds what it may ever be given; the device takes the
    current away `watchdog_s` after our last frame.
    """

    driver: Literal["coil_serial"]
    baud: Annotated[int, Field(ge=115_200, le=12_000_000)] = 2_000_000
    counts_per_m: Annotated[float, Field(gt=0)]
    sign: Sign = 1
    newton_per_ampere: Annotated[float, Field(gt=0, le=1000)]
    max_current_a: Annotated[float, Field(gt=0, le=32)]
    actuator_delay_s: Annotated[float, Field(ge=0.001, le=0.02)] = 0.002
    """From `render` to a state with its current: median 1.9 ms (`python -m benchmarks.hardware`)."""
    watchdog_s: Annotated[float, Field(ge=0.005, le=0.1)] = 0.02
