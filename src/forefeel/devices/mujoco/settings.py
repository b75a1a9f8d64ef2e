"""YAML settings of the worlds by MuJoCo."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from forefeel.common.config import Settings
from forefeel.common.settings import ExistingFile
from forefeel.devices.shared.settings import Sign
from forefeel.slave.plant.foreign import WorldDriverSettings

_Length = Annotated[float, Field(gt=0.0, le=1.0)]


class MujocoSettings(WorldDriverSettings):
    """A MuJoCo model whose timestep is a whole part of 1 ms.

    `drive`: the position actuator, or the joint, that the carriage is; a joint is moved as it is told, an
    actuator by its own gain. `force`: the sensor that is the load cell, of a joint or an actuator, or of a
    site (`force_axis`: which of its three numbers); `force_sign`: -1 where it reads the reaction. `unit_m`:
    of the model's length, whose force is in N times that (kg, s). `inserted_m`: the drive goes there first,
    within `settle_s`. `overlap_m`: that bodies may have; more is no physics, but a wire that leaves its
    vessel. `shape`: the body whose descendants are drawn.
    """

    driver: Literal["mujoco"]
    model: ExistingFile
    drive: str
    force: str
    force_axis: Annotated[int, Field(ge=0, le=2)] = 0
    force_sign: Sign = 1
    unit_m: _Length = 1.0
    inserted_m: Annotated[float, Field(ge=-1.0, le=1.0)] = 0.0
    settle_s: Annotated[float, Field(ge=0.0, le=60.0)] = 1.0
    overlap_m: _Length = 2e-4
    shape: str | None = None


class PieceSettings(Settings):
    """A piece of a vessel: a straight of `length_m`, or an arc of `radius_m` that turns by `turn_deg`,
    negative to the right.
    """

    length_m: _Length | None = None
    radius_m: _Length | None = None
    turn_deg: Annotated[float, Field(ge=-270.0, le=270.0)] | None = None

    @model_validator(mode="after")
    def _straight_or_arc(self) -> Self:
        arc = self.radius_m is not None and bool(self.turn_deg)
        if arc == (self.length_m is not None):
            raise ValueError("expected length_m, or radius_m and turn_deg")
        return self


class WireSettings(Settings):
    """Bending stiffness, radius, and the length of a segment of its chain; with a tapered tip or without."""

    stiffness_n_m2: Annotated[float, Field(ge=1e-6, le=1e-1)]
    radius_m: Annotated[float, Field(gt=0.0, le=5e-3)]
    segment_m: Annotated[float, Field(ge=1e-3, le=1e-2)] = 3e-3
    soft_tip: bool = True


class GuidewireSettings(WorldDriverSettings):
    """A guidewire that is pushed out of a straight guide catheter of `guide_m`, which the travel of the
    stage has to fit into, through the pieces of a planar vessel. `inserted_m`: of the wire beyond the guide,
    at the start.
    """

    driver: Literal["vessel"]
    wire: WireSettings
    guide_m: _Length
    inserted_m: _Length
    lumen_m: Annotated[float, Field(gt=0.0, le=0.05)]
    friction: Annotated[float, Field(ge=0.0, le=2.0)]
    pieces: Annotated[tuple[PieceSettings, ...], Field(min_length=1, max_length=32)]
