"""The slave's YAML file: devices, gate and simulated world of each axis."""

from math import e, inf, pi
from typing import Annotated, Any, Literal, Self

from pydantic import Field, SerializeAsAny, model_validator

from forefeel.common.config import Settings
from forefeel.common.hardware.driver import driver_settings
from forefeel.common.limiter import Reaction
from forefeel.common.settings import (
    LONGEST_ROUND_TRIP_S,
    STOP_M,
    STOP_S,
    TICK_NS,
    AxisSettings,
    Bound,
    DaemonSettings,
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


class InstrumentSettings(Settings):
    """Loads at which the instrument gives way; null: not known. They warn, and stop nothing.

    `holding_n`: at which it slips through the jaws. `euler_n_m2`: pi^2 EI / K^2 of the wire, with
    `free_length_m` between gripper and sheath at position 0: at which it bows out.
    """

    holding_n: Annotated[float, Field(gt=0, le=1e4)] | None = None
    euler_n_m2: Annotated[float, Field(gt=0, le=1e3)] | None = None
    free_length_m: Annotated[float, Field(gt=0, le=10)] | None = None

    @model_validator(mode="after")
    def _both_or_none(self) -> Self:
        if (self.euler_n_m2 is None) != (self.free_length_m is None):
            raise ValueError("euler_n_m2 and free_length_m belong together: expected both, or none")
        return self


StageSection = Annotated[SerializeAsAny[StageDriverSettings], driver_settings("stage")]
GripperSection = Annotated[SerializeAsAny[GripperDriverSettings], driver_settings("gripper")]
LoadCellSection = Annotated[SerializeAsAny[LoadCellDriverSettings], driver_settings("load_cell")]


_SIMULATED: Any = {"driver": "simulated"}  # read as if it stood in the file


_REQUIRED = {
    "load_cell": "load_cell: {driver: simulated} # or another of `forefeel devices`",
    "gripper": "gripper: {driver: simulated} # or another of `forefeel devices`",
    "load_cell.filter_lag_s": "filter_lag_s: 0.005 # of the amplifier's filter, 1 / (2 pi corner)",
    "load_cell.pushes_only": "pushes_only: true # false where inertia, gravity or friction pull inwards",
}
"""Settings without default beside a real stage, each with a line that would do; of devices if hardware."""
_INSTRUMENT_N = 15.0
"""Force that the strongest joints of a catheter have to bear (ISO 10555-1, of 1.85 mm and more)."""
_INDENTATION_M = 0.01
"""Way from touch to force limit: at 3 N of a wall of 300 N/m, about as soft as the presets' presliding."""


class SlaveAxisSettings(AxisSettings):
    """One axis of the slave. `limits` must equal the master's."""

    gate: GateSettings = GateSettings()
    stage: StageSection = _SIMULATED
    gripper: GripperSection = _SIMULATED
    load_cell: LoadCellSection = _SIMULATED
    instrument: InstrumentSettings = InstrumentSettings()
    simulation: WorldSettings = world_settings({"preset": "catheter"})
    seed: int = 0

    @property
    def pushes_only(self) -> bool:
        """True where the load cell says so, or the world of a simulated one."""
        simulated = self.load_cell.driver == "simulated" and self.simulation.load_cell.pushes_only
        return self.load_cell.pushes_only or simulated

    @property
    def sign_setting(self) -> str:
        """Place of the force's sign in the settings."""
        foreign = self.load_cell.driver == "simulated" and hasattr(self.simulation.world, "force_sign")
        return "simulation.world.force_sign" if foreign else "load_cell.sign"

    @property
    def columns(self) -> tuple[str, ...]:
        hidden = self.simulation.hidden
        return self.simulation.contact.columns + (hidden.effects.columns if hidden else ())

    @property
    def bounds(self) -> tuple[Bound, ...]:
        """Ranges in which the settings of gate and limits protect, some derived from this axis's own limits:
        key, least, most, reason. Outside them a setting needs `unsafe` with a real stage.
        """
        limits = self.limits
        v_m_s, a_m_s2 = limits.max_velocity_m_s, limits.max_acceleration_m_s2
        stop_m_s2, silence_s = max(v_m_s / STOP_S, v_m_s**2 / (2 * STOP_M)), min(STOP_S, STOP_M / v_m_s)
        within = f"within {STOP_M * 1e3:g} mm and {STOP_S:g} s at max_velocity_m_s"
        return (
            ("gate.stop_deceleration_m_s2", stop_m_s2, inf, f"a stop {within}"),
            ("gate.watchdog_s", TICK_NS * 1e-9, silence_s, f"silence is noticed {within}"),
            ("gate.force_timeout_s", 0.0, STOP_S, "a force limit without a force"),
            ("gate.max_age_s", 0.0, STOP_S, "an older command is of another moment"),
            ("gate.lease_s", 0.0, LONGEST_ROUND_TRIP_S, "who is silent for longer is gone"),
            ("gate.alignment_m", 0.0, 0.2 * STOP_M, "5 times as far away is borne on engaging"),
            ("gate.engage_ramp_s", v_m_s / a_m_s2, inf, "steeper than max_acceleration_m_s2"),
            ("limits.max_acceleration_m_s2", 0.0, v_m_s / (TICK_NS * 1e-9), "full speed in one tick"),
            ("limits.max_force_n", 0.0, _INSTRUMENT_N, "what instruments have to bear"),
            ("limits.stiffest_wall_n_m", limits.max_force_n / _INDENTATION_M, inf, "10 mm before the limit"),
        )

    def reaction(self, reading_s: float = 2 * TICK_NS * 1e-9) -> Reaction:
        """Lateness of the force after the setpoint, in s by its parts: from the settings' lags. The filter of
        a simulated cell adds to its lag, the bandwidth of a simulated stage replaces the stage's.
        `reading_s`: age of a reading when it is replaced.

        A servo of critical damping with velocity feed-forward, w its bandwidth, answers a ramp with the
        deviation t exp(-w t): at most exp(-2 w t) of a setpoint does not show, and v / e w comes after it.
        """
        filter_s, stage_s, run_on_s = self.load_cell.filter_lag_s, self.stage.lag_s, self.stage.lag_s / e
        if self.load_cell.driver == "simulated":
            filter_s += 1.0 / (2.0 * pi * self.simulation.load_cell.filter_hz)
        if self.stage.driver == "simulated":
            w = 2.0 * pi * self.simulation.stage.bandwidth_hz
            stage_s, run_on_s = 0.5 / w, 1.0 / (e * w)
        return Reaction(reading_s, filter_s, stage_s, run_on_s)

    @model_validator(mode="after")
    def _written_out(self) -> Self:
        """Raises ValueError where the stage is hardware and the file does not name the gripper, the load cell
        or, of a hardware cell, `filter_lag_s` and `pushes_only`.
        """
        for place, line in _REQUIRED.items() if self.stage.hardware else ():
            slot, _, key = place.rpartition(".")
            owner = getattr(self, slot) if slot else self
            if key not in owner.model_fields_set and getattr(owner, "hardware", True):
                raise ValueError(f"{place}: missing, required with a real stage; add the line {line}")
        return self

    @model_validator(mode="after")
    def _force_limit_is_measurable(self) -> Self:
        """Raises ValueError where `limits.max_force_n` is above 95 % of the load cell's full scale; an
        unknown full scale is not judged.
        """
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
        """Raises ValueError where `limits.workspace_m` is not within the stage's travel, if that is known."""
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
