"""Which driver moves the stage, and what it has to know."""

from typing import Annotated, Literal

from pydantic import Field

from forefeel.common.config import Settings
from forefeel.common.hardware.settings import CanSettings, SerialSettings, Sign
from forefeel.common.settings import ExistingFile

Travel = tuple[float, float]


class SimulatedStageDriver(Settings):
    """The stage of the axis' simulated world."""

    driver: Literal["simulated"] = "simulated"


class ZaberSettings(SerialSettings):
    """A Zaber stage that speaks ASCII. It has no watchdog of its own: it is only ever sent to absolute
    targets at most `lead_s` ahead, so that it comes to rest by itself.

    `microstep_m`: metres per microstep; the device's zero is its home. `travel_m`: where it may go.
    """

    driver: Literal["zaber_ascii"]
    device: Annotated[int, Field(ge=1, le=99)] = 1
    axis: Annotated[int, Field(ge=1, le=9)] = 1
    microstep_m: Annotated[float, Field(gt=0, le=1e-3)]
    sign: Sign = 1
    travel_m: Travel
    max_velocity_m_s: Annotated[float, Field(gt=0, le=10)] = 0.1
    max_acceleration_m_s2: Annotated[float, Field(gt=0, le=1000)] = 4.0
    lead_s: Annotated[float, Field(gt=0, le=0.3)] = 0.060
    calibration: ExistingFile | None = None

    @property
    def native_per_m(self) -> float:
        """Microsteps per metre."""
        return 1.0 / self.microstep_m


class HomingSettings(Settings):
    """How a CiA 402 drive finds its reference, for `forefeel calibrate stage` alone.

    `method`: of object 6098: 17 and 18 are the negative and the positive limit switch, by the drive's own
    count; 37 (35 in older drives) takes where the stage stands, nothing moves. `home_m`: the position x of
    the reference. `search_velocity_m_s`: towards the switch; `zero_velocity_m_s`: off it again.
    """

    method: Annotated[int, Field(ge=-128, le=37)] = 37
    home_m: Annotated[float, Field(ge=-10, le=10)] = 0.0
    search_velocity_m_s: Annotated[float, Field(gt=0, le=0.05)] = 0.005
    zero_velocity_m_s: Annotated[float, Field(gt=0, le=0.05)] = 0.001
    acceleration_m_s2: Annotated[float, Field(gt=0, le=10)] = 0.1


class Cia402Settings(Settings):
    """A CiA 402 drive in cyclic synchronous position mode. `counts_per_m`: of its encoder, gear and lead in.

    `heartbeat_s`: how often both ends say that they live; the drive stops by itself after three of ours.
    """

    driver: Literal["cia402"]
    can: CanSettings
    node_id: Annotated[int, Field(ge=1, le=127)]
    counts_per_m: Annotated[float, Field(gt=0)]
    sign: Sign = 1
    travel_m: Travel
    max_velocity_m_s: Annotated[float, Field(gt=0, le=10)] = 0.2
    following_error_m: Annotated[float, Field(gt=0, le=0.1)] = 0.002
    sync_hz: Annotated[int, Field(ge=50, le=1000)] = 250
    heartbeat_s: Annotated[float, Field(ge=0.01, le=1)] = 0.02
    homing: HomingSettings = HomingSettings()
    calibration: ExistingFile | None = None

    @property
    def native_per_m(self) -> float:
        """Counts per metre."""
        return self.counts_per_m


StageDriver = Annotated[SimulatedStageDriver | ZaberSettings | Cia402Settings, Field(discriminator="driver")]
