"""YAML settings of a CiA 402 drive."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from forefeel.common.config import Settings
from forefeel.devices.cia402.protocol import interpolation_period
from forefeel.devices.shared.settings import CanSettings, NodeId, ScaledStageSettings


class HomingSettings(Settings):
    """Homing of a CiA 402 drive, for `forefeel home` and `forefeel calibrate stage` alone.

    `method`: of object 6098: 17 and 18 are the negative and the positive limit switch, by the drive's own
    count; 37 (35 in older drives) takes where the stage stands, nothing moves. `home_m`: the position x of
    the reference. `search_velocity_m_s`: towards the switch; `zero_velocity_m_s`: off it again.
    """

    method: Annotated[int, Field(ge=-128, le=37)] = 37
    home_m: Annotated[float, Field(ge=-10, le=10)] = 0.0
    search_velocity_m_s: Annotated[float, Field(gt=0, le=0.05)] = 0.005
    zero_velocity_m_s: Annotated[float, Field(gt=0, le=0.05)] = 0.001
    acceleration_m_s2: Annotated[float, Field(gt=0, le=10)] = 0.1


class Cia402Settings(ScaledStageSettings):
    """A CiA 402 drive in cyclic synchronous position mode. `counts_per_m`: of its encoder, gear and lead in.

    `heartbeat_s`: how often both ends say that they live; the drive stops by itself after three of ours.
    """

    driver: Literal["cia402"]
    can: CanSettings
    node_id: NodeId
    counts_per_m: Annotated[float, Field(gt=0)]
    max_velocity_m_s: Annotated[float, Field(gt=0, le=10)] = 0.2
    following_error_m: Annotated[float, Field(gt=0, le=0.02)] = 0.002
    sync_hz: Annotated[int, Field(ge=50, le=1000)] = 250
    heartbeat_s: Annotated[float, Field(ge=0.01, le=0.1)] = 0.02
    homing: HomingSettings = HomingSettings()

    @model_validator(mode="after")
    def _cycle_is_possible(self) -> Self:
        if interpolation_period(self.sync_hz) is None:
            raise ValueError(f"sync_hz = {self.sync_hz}: expected a period in tenths of a millisecond")
        if self.heartbeat_s * self.sync_hz < 1.0:
            raise ValueError(f"heartbeat_s = {self.heartbeat_s:g}: expected at least 1 / sync_hz")
        return self

    @property
    def native_per_m(self) -> float:
        return self.counts_per_m
