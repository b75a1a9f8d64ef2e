"""YAML settings of a Zaber stage."""

from typing import Annotated, Literal

from pydantic import Field

from forefeel.devices.shared.settings import ScaledStageSettings, SerialSettings


class ZaberSettings(SerialSettings, ScaledStageSettings):
    """A Zaber stage that speaks ASCII. It has no watchdog of its own: it is only ever sent to absolute
    targets at most `lead_s` ahead, so that it comes to rest by itself.

    `microstep_m`: metres per microstep; the device's zero is its home. `lag_s`: two exchanges in a row, of
    50 ms and more each, may stay without an answer.
    """

    driver: Literal["zaber_ascii"]
    device: Annotated[int, Field(ge=1, le=99)] = 1
    axis: Annotated[int, Field(ge=1, le=9)] = 1
    microstep_m: Annotated[float, Field(gt=0, le=1e-3)]
    max_velocity_m_s: Annotated[float, Field(gt=0, le=10)] = 0.1
    max_acceleration_m_s2: Annotated[float, Field(gt=0, le=1000)] = 4.0
    lead_s: Annotated[float, Field(gt=0, le=0.3)] = 0.060
    lag_s: Annotated[float, Field(gt=0, le=0.3)] = 0.2

    @property
    def native_per_m(self) -> float:
        return 1.0 / self.microstep_m
