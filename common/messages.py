"""The wire contract: every message that crosses the network.

All are frozen pydantic models: unknown fields are refused, numbers are finite, units stand in the names. SI
only. A rotation
axis uses the tangential equivalents (arc length in m, tangential force in N), see docs/decisions/0003.
"""

from enum import StrEnum
from typing import Annotated, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field

PROTOCOL_VERSION = 1

NonNegativeInt = Annotated[int, Field(ge=0, le=2**63 - 1)]
Int64 = Annotated[int, Field(ge=-(2**63), le=2**63 - 1)]
Stamp = Int64
ShortText = Annotated[str, Field(max_length=256)]
DIGEST = r"^[0-9a-f]{64}$"
"""A SHA-256 in hexadecimal digits."""
Name = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[A-Za-z0-9_.-]+$")]


class Message(BaseModel):
    """What every message carries: protocol version, session, sequence and the sender's monotonic stamp.

    `most_bytes`, `most_items`: what an encoded message of the kind, and an array or map in it, may hold. A
    forged one that claims more is refused before it costs the control loop its time.
    """

    most_bytes: ClassVar[int] = 2048
    most_items: ClassVar[int] = 64

    model_config: ClassVar[ConfigDict] = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, protected_namespaces=()
    )

    protocol: Annotated[int, Field(ge=1, le=2**31)] = PROTOCOL_VERSION
    session_id: NonNegativeInt
    sequence: NonNegativeInt
    stamp_ns: Stamp


class SafetyState(StrEnum):
    """The slave's safety state. Motion is commanded in ENGAGING, ARMED and (ramping down) STOPPING only."""

    IDLE = "idle"
    READY = "ready"
    ENGAGING = "engaging"
    ARMED = "armed"
    STOPPING = "stopping"
    FAULT = "fault"
    ESTOPPED = "estopped"


FOLLOWING = frozenset({SafetyState.ENGAGING, SafetyState.ARMED})
"""The states in which the stage follows commands."""


class Grip(StrEnum):
    """What the fixture on the stage does with the instrument."""

    CLOSED = "closed"
    OPEN = "open"


State = Annotated[SafetyState, Field(strict=False)]
Gripper = Annotated[Grip, Field(strict=False)]


class Handshake(Message):
    """Opens a session (master) or answers it (slave). Both refuse to arm when protocol or settings differ.

    `answers_stamp_ns`: of the handshake that an answer answers. The master measures with it how long the
    answer took, for it asks several times under one session id.
    """

    most_bytes: ClassVar[int] = 24 * 1024

    role: Literal["master", "slave"]
    instance_id: NonNegativeInt
    software: ShortText
    settings_hash: ShortText
    settings: Annotated[str, Field(max_length=4096)] = ""
    accepted: bool = False
    reason: ShortText = ""
    answers_stamp_ns: Stamp | None = None


class MotionCommand(Message):
    """One setpoint of the master: an absolute position (never an increment), 1 kHz."""

    position_m: float
    velocity_m_s: float
    deadman: bool
    gripper: Gripper = Grip.CLOSED
    recording_time_s: float | None = None


class ForceSample(Message):
    """One load-cell reading with the stage readback of the same instant and the command it answers."""

    position_m: float
    velocity_m_s: float
    force_n: float
    raw_counts: Int64
    valid: bool
    answers_sequence: NonNegativeInt | None
    answers_stamp_ns: Stamp | None
    recording_time_s: float | None = None
    gripper: Gripper = Grip.CLOSED
    clock_offset_ns: Stamp | None = None
    clock_bound_ns: NonNegativeInt | None = None


class HapticSample(Message):
    """One tick of the haptic loop: what the hand did and felt. `sequence` is that of the command sent in the
    same tick.

    `delay_s`: from the command `answered_sequence` to the arrival of the force that answers it, both on the
    master's clock. `low_n`, `high_n`: the 95 % band of the prediction; `leading`: the expert that led it, or
    `hold`. `energy_j`: what the hand has put into the handle since the start; negative where the
    rendered force gave it more than it took.
    """

    handle_position_m: float
    command_position_m: float
    predicted_n: float | None
    low_n: float | None = None
    high_n: float | None = None
    leading: ShortText = ""
    held_n: float | None
    rendered_n: float
    force_age_s: float | None
    delay_s: float | None
    answered_sequence: NonNegativeInt | None
    limited: bool
    energy_j: float = 0.0


class ModelParameters(Message):
    """The identified contact model: values, standard deviations and what the motion lets one tell apart."""

    most_bytes: ClassVar[int] = 64 * 1024
    most_items: ClassVar[int] = 256

    names: tuple[Name, ...]
    values: tuple[float, ...]
    standard_deviations: tuple[float, ...]
    identifiable: tuple[ShortText, ...]
    valid: bool
    samples: NonNegativeInt
    updates: NonNegativeInt
    resets: NonNegativeInt
    innovation_rms_n: float


class SlaveState(Message):
    """The slave's state, 50 Hz: safety state, readback and counters.

    `latch_persisted`: whether what is latched is on the slave's disk, so that a new start finds it. A stop is
    acknowledged by ESTOPPED together with it.
    """

    most_bytes: ClassVar[int] = 24 * 1024
    most_items: ClassVar[int] = 256

    state: State
    reason: ShortText
    latch_persisted: bool = True
    position_m: float
    velocity_m_s: float
    gripper: Gripper
    stops: NonNegativeInt
    clock_offset_ns: Stamp | None
    clock_bound_ns: NonNegativeInt | None
    counters: dict[Name, NonNegativeInt]

    @property
    def acknowledges_stop(self) -> bool:
        """Whether the axis is stopped, and stays so over a new start."""
        return self.state is SafetyState.ESTOPPED and self.latch_persisted


class MasterState(Message):
    """The master's state, 10 Hz: what it shows to the operator, delay and counters."""

    most_bytes: ClassVar[int] = 24 * 1024
    most_items: ClassVar[int] = 256

    indication: Name
    reason: ShortText
    deadman: bool
    clutched_s: float
    clock_offset_ns: Stamp | None
    clock_bound_ns: NonNegativeInt | None
    counters: dict[Name, NonNegativeInt]


class Heartbeat(Message):
    """Keeps the lease and carries the four time stamps: mine, and the newest of the peer with its receive
    stamp.
    """

    echo_stamp_ns: Stamp | None = None
    echo_receive_ns: Stamp | None = None


class LimitEvent(Message):
    """A command that the slave's gate changed or refused, or a force that the master's renderer changed: what
    was asked, what was applied, by which rule, how often since the last event.
    """

    rule: Name
    requested: float
    applied: float
    unit: ShortText
    count: NonNegativeInt


class SafetyEvent(Message):
    """A transition of the safety state machine."""

    before: State
    event: Name
    after: State
    reason: ShortText


class ControlCycle(Message):
    """One tick of the slave's control loop. Never published: the flight recorder writes it.

    `executed_sequence`: of the command that the setpoint follows.
    """

    setpoint_m: float
    setpoint_velocity_m_s: float
    moving: bool
    position_m: float
    velocity_m_s: float
    force_n: float
    force_valid: bool
    state: State
    gripper: Gripper
    executed_sequence: NonNegativeInt | None


class MasterEvent(Message):
    """A change of how the master stands: `no_link`, `linked`, `handle_fault` or `failed`."""

    before: Name
    event: Name
    after: Name
    reason: ShortText


class EmergencyStop(Message):
    """Latched stop from anyone; outside every queue and filter. Cleared only by a local act at the slave."""

    source: Name
    reason: ShortText


class Calibration(Message):
    """The calibration that a driver of the slave has loaded, said again and again for whoever records.

    Load cell: `F = gain_n (native - zero)`. Stage: `native = zero + native_per_m x`. The sign of the settings
    is in neither. `serial`: of the device that answers; `date`: ISO 8601. What a slot does not have is None.
    """

    slot: Literal["stage", "load_cell"]
    driver: ShortText
    serial: ShortText
    date: ShortText
    zero: float
    gain_n: float | None = None
    residual_n: float | None = None
    hysteresis_n: float | None = None
    native_per_m: float | None = None
    repeatability_m: float | None = None


class LoopTiming(Message):
    """Lateness of a fixed-rate loop since its start: quantiles, maximum, and the histogram they come from.

    `edges_us`: upper edges of its bins; `counts` has one more, of what was later than the last.
    """

    most_bytes: ClassVar[int] = 24 * 1024
    most_items: ClassVar[int] = 1024

    loop: Name
    ticks: NonNegativeInt
    missed: NonNegativeInt
    p50_us: float
    p99_us: float
    max_us: float
    edges_us: tuple[float, ...]
    counts: tuple[NonNegativeInt, ...]
    scheduling: ShortText


class AuditHead(Message):
    """The end of the sender's audit log, for the other end's log: what is cut off or removed shows there.

    `number`, `hash`: of the newest entry that is not itself about the other end's log.
    """

    number: NonNegativeInt
    hash: Annotated[str, Field(pattern=DIGEST)]


class ImpairmentTrace(Message):
    """What the impairment did to each message of a link: its delays in ns; none = lost, two = doubled."""

    most_bytes: ClassVar[int] = 64 * 1024
    most_items: ClassVar[int] = 1024

    link: ShortText
    first_index: NonNegativeInt
    delays_ns: tuple[tuple[NonNegativeInt, ...], ...]
