"""The master's YAML file: handle, prediction and rendering of each axis."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from forefeel.common.config import Settings
from forefeel.common.hardware.settings import SerialSettings, Sign
from forefeel.common.settings import (
    AxisLimits,
    ColumnSettings,
    DaemonSettings,
    ExistingFile,
    Segment,
    require_distinct,
)
from forefeel.common.topics import FORCE


class OperatorSettings(Settings):
    """The synthetic operator: strokes, tremor and arm (arm values: typical of a relaxed hand in one axis).

    `restroke`: withdraws with the fixture open, so that every stroke inserts the instrument further.
    """

    driver: Literal["operator"] = "operator"
    home_m: Annotated[float, Field(ge=-1, le=1)] = 0.005
    depth_m: Annotated[float, Field(gt=0, le=0.5)] = 0.030
    insert_s: Annotated[float, Field(ge=0.2, le=60)] = 1.8
    withdraw_s: Annotated[float, Field(ge=0.2, le=60)] = 1.4
    dwell_s: Annotated[float, Field(ge=0, le=60)] = 0.6
    restroke: bool = False
    tremor_m: Annotated[float, Field(ge=0, le=0.005)] = 0.0002
    arm_mass_kg: Annotated[float, Field(gt=0.01, le=20)] = 0.4
    arm_damping_n_s_m: Annotated[float, Field(ge=0, le=200)] = 12.0
    arm_stiffness_n_m: Annotated[float, Field(gt=1, le=5000)] = 250.0
    seed: int = 0


class RecordingSettings(Settings):
    """Plays the position of a recording."""

    driver: Literal["recording"]
    recording: ExistingFile
    columns: ColumnSettings | None = None
    gap_s: Annotated[float, Field(gt=0, le=10)] = 0.1
    approach_m_s: Annotated[float, Field(gt=0, le=1)] = 0.03


class SineSettings(Settings):
    """A sine around `centre_m`."""

    driver: Literal["sine"]
    centre_m: float = 0.02
    amplitude_m: Annotated[float, Field(gt=0, le=0.5)] = 0.01
    frequency_hz: Annotated[float, Field(gt=0, le=50)] = 0.5
    approach_m_s: Annotated[float, Field(gt=0, le=1)] = 0.03


class MultiSineSettings(Settings):
    """Several sines of equal amplitude around `centre_m`, whose sum is at most `amplitude_m`."""

    driver: Literal["multisine"]
    centre_m: float = 0.02
    amplitude_m: Annotated[float, Field(gt=0, le=0.5)] = 0.01
    frequencies_hz: Annotated[tuple[float, ...], Field(min_length=2, max_length=20)] = (0.23, 0.61, 1.37, 2.9)
    approach_m_s: Annotated[float, Field(gt=0, le=1)] = 0.03


class CoilSettings(SerialSettings):
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
    watchdog_s: Annotated[float, Field(ge=0.005, le=0.1)] = 0.02


HandleSettings = Annotated[
    OperatorSettings | RecordingSettings | SineSettings | MultiSineSettings | CoilSettings,
    Field(discriminator="driver"),
]


class PredictionSettings(Settings):
    """The contact model and how it is learned. `model`: a model.yaml; m, b, k, bias and friction without
    one.

    `cutoff_hz`: of the filter that motion and force pass alike before identification; `velocity_cutoff_hz`:
    of the handle's velocity.
    """

    model: ExistingFile | None = None
    memory_s: Annotated[float, Field(gt=0, le=3600)] = 2.0
    cutoff_hz: Annotated[float, Field(gt=0, le=400)] = 15.0
    velocity_cutoff_hz: Annotated[float, Field(gt=0, le=400)] = 40.0
    typical_stroke_m: Annotated[float, Field(gt=0, le=10)] = 0.01
    noise_floor_n: Annotated[float, Field(gt=0, le=1000)] = 0.001


class RenderingSettings(Settings):
    """What the hand may feel: scaled, limited in N and in N/s, faded to zero when the feedback is older than
    `stale_s`.

    `source`: the predicted force, or (to compare) the newest one that arrived. `max_jump_n_s`: how fast the
    force may change without a motion of the hand. `max_stiffness_n_m`: how much of it per metre of motion; a
    hand and handle that damp with b N s/m stay stable below 2 b / T (Colgate and Schenkel 1997; T = 1 ms).
    `passivity_controller`: damps the hand by up to `max_damping_n_s_m` while it has been given energy.
    """

    source: Literal["predicted", "held"] = "predicted"
    force_scale: Annotated[float, Field(gt=0, le=100)] = 1.0
    max_force_n: Annotated[float, Field(gt=0, le=50)] = 4.0
    max_slew_n_s: Annotated[float, Field(gt=0, le=10_000)] = 40.0
    max_jump_n_s: Annotated[float, Field(gt=0, le=10_000)] = 10.0
    max_stiffness_n_m: Annotated[float, Field(gt=0, le=100_000)] = 4000.0
    passivity_controller: bool = True
    max_damping_n_s_m: Annotated[float, Field(ge=0, le=1000)] = 10.0
    stale_s: Annotated[float, Field(gt=0, le=2)] = FORCE.stale_after_s or 0.1
    fade_s: Annotated[float, Field(gt=0, le=5)] = 0.2

    @model_validator(mode="after")
    def _fades_in_time(self) -> Self:
        shortest_s = self.max_force_n / self.max_slew_n_s
        if self.fade_s < shortest_s:
            raise ValueError(
                f"fade_s = {self.fade_s}: expected at least max_force_n / max_slew_n_s = {shortest_s:g}"
            )
        return self


class MasterAxisSettings(Settings):
    """One axis of the master. `limits` must equal the slave's."""

    name: Segment = "insertion"
    limits: AxisLimits = AxisLimits()
    handle: HandleSettings = OperatorSettings()
    prediction: PredictionSettings = PredictionSettings()
    rendering: RenderingSettings = RenderingSettings()


class MasterSettings(DaemonSettings):
    """deploy/config/master.yaml. `peer_timeout_s`: how long a slave that does not answer is waited for; null:
    for ever.
    """

    role: Literal["master"] = "master"
    peer_timeout_s: Annotated[float, Field(gt=0, le=86_400)] | None = 60.0
    axes: Annotated[tuple[MasterAxisSettings, ...], Field(min_length=1)] = (MasterAxisSettings(),)

    @model_validator(mode="after")
    def _distinct(self) -> Self:
        require_distinct([axis.name for axis in self.axes])
        return self
