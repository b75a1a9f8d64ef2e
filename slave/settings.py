"""The slave's YAML file: devices, gate and simulated world of each axis."""

from typing import Annotated, Any, Literal, Self

from pydantic import Field, SerializeAsAny, model_validator

from forefeel.common.config import Settings
from forefeel.common.hardware.driver import DriverSettings, driver_settings
from forefeel.common.settings import (
    LONGEST_ROUND_TRIP_S,
    AxisLimits,
    DaemonSettings,
    Segment,
    require_distinct,
)
from forefeel.common.topics import COMMAND
from forefeel.slave.gripper import GripperDriverSettings
from forefeel.slave.load_cell import VALID_SHARE, LoadCellDriverSettings
from forefeel.slave.plant.settings import WorldSettings, world_settings
from forefeel.slave.stage import StageDriverSettings


class GateSettings(Settings):
    """Constants of the safety gate (see docs/explanation/safety.md for the reasons)."""

    watchdog_s: Annotated[float, Field(ge=0, le=0.3)] = COMMAND.stale_after_s or 0.060
    max_age_s: Annotated[float, Field(gt=0, le=1)] = 0.100
    max_round_trip_s: Annotated[float, Field(gt=0, le=LONGEST_ROUND_TRIP_S)] = 0.700
    lease_s: Annotated[float, Field(ge=0.2, le=10)] = 1.0
    alignment_m: Annotated[float, Field(gt=0, le=0.05)] = 0.001
    engage_ramp_s: Annotated[float, Field(gt=0, le=5)] = 0.2
    stop_deceleration_m_s2: Annotated[float, Field(gt=0, le=1000)] = 4.0
    force_timeout_s: Annotated[float, Field(gt=0, le=5)] | None = 0.2


StageSection = Annotated[SerializeAsAny[StageDriverSettings], driver_settings("stage")]
GripperSection = Annotated[SerializeAsAny[GripperDriverSettings], driver_settings("gripper")]
LoadCellSection = Annotated[SerializeAsAny[LoadCellDriverSettings], driver_settings("load_cell")]


_SIMULATED: Any = {"driver": "simulated"}  # read as if it stood in the file


class SlaveAxisSettings(Settings):
    name: Segment = "insertion"
    limits: AxisLimits = AxisLimits()
    gate: GateSettings = GateSettings()
    stage: StageSection = _SIMULATED
    gripper: GripperSection = _SIMULATED
    load_cell: LoadCellSection = _SIMULATED
    simulation: WorldSettings = world_settings({"preset": "catheter"})
    seed: int = 0

    @property
    def pushes_only(self) -> bool:
        """Of the load cell; of the simulated one also where its world says so."""
        simulated = self.load_cell.driver == "simulated" and self.simulation.load_cell.pushes_only
        return self.load_cell.pushes_only or simulated

    @model_validator(mode="after")
    def _written_out_beside_a_real_stage(self) -> Self:
        for slot in ("load_cell", "gripper", "stage") if self.stage.hardware else ():
            section: DriverSettings = getattr(self, slot)
            lines = {f"{slot}.{key}": line for key, line in section.required.items() if section.hardware}
            lines = {k: v for k, v in lines.items() if k.partition(".")[2] not in section.model_fields_set}
            if slot not in self.model_fields_set:
                lines = {slot: f"{slot}: {{driver: simulated}} # or another of `forefeel devices`"}
            for key, line in lines.items():
                raise ValueError(f"{key}: missing, required with a real stage; add the line {line}")
        return self

    @model_validator(mode="after")
    def _watchdog_is_on(self) -> Self:
        if self.gate.watchdog_s == 0 and self.stage.hardware:
            raise ValueError("gate.watchdog_s = 0: expected more than 0 with a real stage")
        return self

    @model_validator(mode="after")
    def _force_limit_is_measurable(self) -> Self:
        place, rated_n = "load_cell.full_scale_n", self.load_cell.rated_n
        if self.load_cell.driver == "simulated":
            place, rated_n = f"simulation.{place}", self.simulation.load_cell.full_scale_n
        if rated_n is None:
            return self
        most_n = VALID_SHARE * rated_n
        if self.limits.max_force_n > most_n:
            raise ValueError(
                f"limits.max_force_n = {self.limits.max_force_n:g}: expected at most {most_n:g}, "
                f"what the load cell can measure ({VALID_SHARE:.0%} of {place})"
            )
        return self

    @model_validator(mode="after")
    def _travel_covers_the_workspace(self) -> Self:
        if self.stage.travel is None:
            return self
        (low, high), (lowest, highest) = self.limits.workspace_m, self.stage.travel
        if not (lowest <= low and high <= highest):
            raise ValueError(
                f"limits.workspace_m = [{low:g}, {high:g}]: expected within stage.travel_m = "
                f"[{lowest:g}, {highest:g}]"
            )
        return self


class SlaveSettings(DaemonSettings):
    """deploy/config/slave.yaml."""

    role: Literal["slave"] = "slave"
    axes: Annotated[tuple[SlaveAxisSettings, ...], Field(min_length=1)] = (SlaveAxisSettings(),)

    @model_validator(mode="after")
    def _distinct(self) -> Self:
        require_distinct([axis.name for axis in self.axes])
        return self

    @property
    def real_stage(self) -> bool:
        """Whether a stage that is not simulated is configured; an emulated one counts as real."""
        return any(axis.stage.hardware for axis in self.axes)
