"""YAML settings of a voice-coil handle."""

from typing import Annotated, Literal

from pydantic import Field

from forefeel.devices.shared.settings import SerialSettings, Sign
from forefeel.master.handle import HandleDriverSettings


class CoilSettings(SerialSettings, HandleDriverSettings):
    """A voice coil with an encoder behind a microcontroller with a watchdog. The device says how often it
    sends states, how late its force is, and, where it knows that, what a metre counts.

    `counts_per_m`: needed where it does not; `newton_per_ampere`: of the coil; `max_current_a` bounds what it
    may ever be given; the device takes the current away `watchdog_s` after our last frame.
    """

    driver: Literal["coil_serial"]
    baud: Annotated[int, Field(ge=115_200, le=12_000_000)] = 500_000
    counts_per_m: Annotated[float, Field(gt=0)] | None = None
    sign: Sign = 1
    newton_per_ampere: Annotated[float, Field(gt=0, le=1000)]
    max_current_a: Annotated[float, Field(gt=0, le=32)]
    watchdog_s: Annotated[float, Field(ge=0.005, le=0.1)] = 0.02
