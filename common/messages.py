"""The wire contract: every message that crosses the network.

All are frozen pydantic models: unknown fields are refused, numbers are within a range, units stand in the
names. SI only. A rotation axis uses the tangential equivalents (arc length in m, tangential force in N), see
docs/decisions/0003.

The ranges are beyond every device, so that what is outside is no measurement; who sends sees to it that what
it computes is within them (`within`).
"""

from enum import StrEnum
from typing import Annotated, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field

PROTOCOL_VERSION = 7  # version of these messages; other versions are refused, except in a handshake

MOST_COUNT = 2**63 - 1  # MessagePack and JSON readers have 64 bits
NonNegativeInt = Annotated[int, Field(ge=0, le=MOST_COUNT)]
Int64 = Annotated[int, Field(ge=-(2**63), le=2**63 - 1)]
Stamp = Int64

MOST_FORCE_N = 10_000.0
"""The largest full scale of a load cell in the settings: thousands of times what an instrument bears."""
MOST_POSITION_M = 10.0
"""Twice the longest guidewire (4.5 m); of a rotation the arc of 1600 turns of an instrument of 2 mm."""
MOST_VELOCITY_M_S = 1000.0
"""The largest `limits.max_velocity_m_s`: a hundred times the fastest stage in the settings."""
MOST_PARAMETER = 1e12
"""In SI: the widest bound of a parameter of an effect (`stiffening`, N/m^3)."""

Force = Annotated[float, Field(ge=-MOST_FORCE_N, le=MOST_FORCE_N)]
Position = Annotated[float, Field(ge=-MOST_POSITION_M, le=MOST_POSITION_M)]
Velocity = Annotated[float, Field(ge=-MOST_VELOCITY_M_S, le=MOST_VELOCITY_M_S)]
MOST_SECONDS = 1e11
"""Holds the sum of any three stamps (2^63 ns are 9.2e9 s), and a recording's time since any epoch."""
Seconds = Annotated[float, Field(ge=-MOST_SECONDS, le=MOST_SECONDS)]
Span = Annotated[float, Field(ge=0.0, le=MOST_SECONDS)]
Microseconds = Annotated[float, Field(ge=-1e16, le=1e16)]
"""2^63 ns are 9.2e15 us."""
Energy = Annotated[float, Field(ge=-1e12, le=1e12)]
"""In J: the largest force at the largest velocity for a day."""
Parameter = Annotated[float, Field(ge=-MOST_PARAMETER, le=MOST_PARAMETER)]
MOST_QUANTITY = 1e12  # the end of the range of `Quantity`, in its unit
Quantity = Annotated[float, Field(ge=-MOST_QUANTITY, le=MOST_QUANTITY)]
"""Of whatever unit: the largest velocity, reversed within 2 ns, is an acceleration of 1e12 m/s^2."""
Native = Annotated[float, Field(ge=-1e12, le=1e12)]
"""In a device's own unit: 32 bits of counts, and per m of a micrometre's thousandth, are less."""
ShortText = Annotated[str, Field(max_length=256)]
MOST_NAME = 64  # characters
Name = Annotated[str, Field(min_length=1, max_length=MOST_NAME, pattern=r"^[A-Za-z0-9_.-]+$")]


def within(value: float, most: float) -> float:
    """The value, or the end of the range +-most that it is beyond."""
    return value if -most <= value <= most else max(-most, min(most, value))


class Message(BaseModel):
    """Base of all messages: protocol version, session, sequence and the sender's monotonic stamp.

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
    """State of the fixture on the stage."""

    CLOSED = "closed"
    OPEN = "open"


State = Annotated[SafetyState, Field(strict=False)]
Gripper = Annotated[Grip, Field(strict=False)]


_MOST_DRIVERS = 4  # slots of an axis, of master and slave together


class Handshake(Message):
    """Opens a session (master) or answers it (slave). Both refuse to arm when protocol or settings differ.

    `answers_stamp_ns`: of the handshake that an answer answers. The master measures with it how long the
    answer took, for it asks several times under one session id. `full_scale_n`: of the slave's load cell; the
    master takes no force beyond it. `drivers`: by slot the driver of the axis, its distribution and version.
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
    full_scale_n: Annotated[float, Field(ge=0.0, le=MOST_FORCE_N)] = 0.0
    drivers: Annotated[dict[ShortText, ShortText], Field(max_length=_MOST_DRIVERS)] = {}


class MotionCommand(Message):
    """One setpoint of the master: an absolute position (never an increment), 1 kHz.

    `low_n`, `high_n`: the 95 % band of the force that the master expects there; None before it is known.
    """

    position_m: Position
    velocity_m_s: Velocity
    deadman: bool
    gripper: Gripper = Grip.CLOSED
    recording_time_s: Seconds | None = None
    low_n: Force | None = None
    high_n: Force | None = None

    @property
    def band_n(self) -> tuple[float, float] | None:
        return None if self.low_n is None or self.high_n is None else (self.low_n, self.high_n)


class ForceSample(Message):
    """One load-cell reading with the stage readback of the same instant and the command it answers.

    `answers_stamp_ns`: of the operator's motion that the stage follows at this instant, on the master's
    clock: of the command, and since when the slave carries it on. `setpoint_m`: what the slave's limits left
    of that command, with `force_limited` its force limit, too.
    """

    position_m: Position
    velocity_m_s: Velocity
    force_n: Force
    raw_counts: Int64
    valid: bool
    answers_sequence: NonNegativeInt | None
    answers_stamp_ns: Stamp | None
    recording_time_s: Seconds | None = None
    gripper: Gripper = Grip.CLOSED
    clock_offset_ns: Stamp | None = None
    clock_bound_ns: NonNegativeInt | None = None
    setpoint_m: Position | None = None
    force_limited: bool = False


class HapticSample(Message):
    """One tick of the haptic loop: what the hand did and felt. `sequence` is that of the command sent in the
    same tick.

    `delay_s`: from the motion that the newest force answers to its arrival, both on the master's clock;
    `answered_sequence`: of the command that the stage followed. `low_n`, `high_n`: the 95 % band of the
    prediction; `leading`: the expert that led it, or `zoh`. `zoh_n`: the last received force, a zero-order
    hold. `energy_j`: what the hand has put into the handle since the start; negative where the rendered force
    gave it more than it took.

    For a replay, `forces`: sequences of those taken since the sample before; `slave_state`: sequence of the
    state by whose `reaction_s` the setpoint was expected; `snapshot`: number of the estimate that was used,
    None up to protocol 6; `snapshot_forces`: how many of all forces taken it rests on; `fit_late`: a fit of
    the contact that was to take effect by then was not done.
    """

    handle_position_m: Position
    command_position_m: Position
    predicted_n: Force | None
    low_n: Force | None = None
    high_n: Force | None = None
    leading: ShortText = ""
    zoh_n: Force | None
    rendered_n: Force
    force_age_s: Seconds | None
    delay_s: Seconds | None
    answered_sequence: NonNegativeInt | None
    limited: bool
    energy_j: Energy = 0.0
    forces: tuple[NonNegativeInt, ...] = ()
    slave_state: NonNegativeInt | None = None
    snapshot: NonNegativeInt | None = None
    snapshot_forces: NonNegativeInt = 0
    fit_late: bool = False


class ModelParameters(Message):
    """The identified contact model: values, standard deviations and what the motion lets one tell apart.

    `prior`: what it started from; empty where nothing is kept. `model`: causes of the model.yaml that it
    predicts with; none once it is dropped.
    """

    most_bytes: ClassVar[int] = 64 * 1024
    most_items: ClassVar[int] = 256

    names: tuple[Name, ...]
    values: tuple[Parameter, ...]
    standard_deviations: tuple[Parameter, ...]
    identifiable: tuple[ShortText, ...]
    valid: bool
    samples: NonNegativeInt
    updates: NonNegativeInt
    resets: NonNegativeInt
    innovation_rms_n: Force
    prior: ShortText = ""
    model: tuple[Name, ...] = ()


class SlaveState(Message):
    """The slave's state, 50 Hz: safety state, readback and counters.

    `latch_persisted`: whether what is latched is on the slave's disk, so that a new start finds it. A stop is
    acknowledged by ESTOPPED together with it. `caveats`: what of the axis is simulated, uncalibrated or
    relaxed. `over_limit`: the force is above its limit. `slipped_m`: about how far the instrument slipped
    through the jaws since `slipped_since_ns`. `near_load`: rule of the load that the force is near to.
    `reaction_s`: how late it answers a setpoint, by the parts of a `forefeel.common.limiter.Reaction`; empty
    where a slave does not say it.
    """

    most_bytes: ClassVar[int] = 24 * 1024
    most_items: ClassVar[int] = 256

    state: State
    reason: ShortText
    latch_persisted: bool = True
    position_m: Position
    velocity_m_s: Velocity
    gripper: Gripper
    stops: NonNegativeInt
    clock_offset_ns: Stamp | None
    clock_bound_ns: NonNegativeInt | None
    over_limit: bool = False
    slipped_m: Span = 0.0
    slipped_since_ns: Stamp | None = None
    near_load: Name | None = None
    reaction_s: tuple[Span, ...] = ()
    counters: dict[Name, NonNegativeInt]
    caveats: tuple[ShortText, ...] = ()

    @property
    def acknowledges_stop(self) -> bool:
        """True when the axis is stopped, and stays so over a new start."""
        return self.state is SafetyState.ESTOPPED and self.latch_persisted


class MasterState(Message):
    """The master's state, 10 Hz: what it shows to the operator, delay, counters, `caveats` as the slave.

    `force_scale`: of the rendered force to the one at the contact; None up to protocol 6.
    """

    most_bytes: ClassVar[int] = 24 * 1024
    most_items: ClassVar[int] = 256

    indication: Name
    reason: ShortText
    deadman: bool
    clutched_s: Seconds
    force_scale: Annotated[float, Field(ge=0.0, le=100.0)] | None = None
    clock_offset_ns: Stamp | None
    clock_bound_ns: NonNegativeInt | None
    counters: dict[Name, NonNegativeInt]
    caveats: tuple[ShortText, ...] = ()


class Heartbeat(Message):
    """Keeps the lease and carries the four stamps: mine, and the peer's newest with its receive stamp."""

    echo_stamp_ns: Stamp | None = None
    echo_receive_ns: Stamp | None = None


class LimitEvent(Message):
    """A command that the slave's gate changed or refused, or a force that the master's renderer changed: what
    was asked, what was applied, by which rule, how often since the last event.
    """

    rule: Name
    requested: Quantity
    applied: Quantity
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

    setpoint_m: Position
    setpoint_velocity_m_s: Velocity
    moving: bool
    position_m: Position
    velocity_m_s: Velocity
    force_n: Force
    force_valid: bool
    state: State
    gripper: Gripper
    executed_sequence: NonNegativeInt | None


class MasterEvent(Message):
    """A change of the status of the master: `no_session`, `in_session`, `handle_fault` or `failed`."""

    before: Name
    event: Name
    after: Name
    reason: ShortText


class EmergencyStop(Message):
    """Latched stop from anyone; outside every queue and filter. Cleared only by a local act at the slave."""

    source: Name
    reason: ShortText


class Calibration(Message):
    """The calibration that a driver of the slave has loaded, published again and again for whoever records.

    Load cell: `F = gain_n (native - zero)`. Stage: `native = zero + native_per_m x`. The sign of the settings
    is in neither. `serial`: of the device that answers; `date`: ISO 8601. What a slot does not have is None.
    """

    slot: Literal["stage", "load_cell"]
    driver: ShortText
    serial: ShortText
    date: ShortText
    zero: Native
    gain_n: Native | None = None
    residual_n: Force | None = None
    hysteresis_n: Force | None = None
    native_per_m: Native | None = None


class InstrumentShape(Message):
    """Centre line of an instrument in a simulated world, tip last, in coordinates of that world: one x, y and
    z a point.
    """

    x_m: tuple[Position, ...]
    y_m: tuple[Position, ...]
    z_m: tuple[Position, ...]


class LoopTiming(Message):
    """Lateness of a fixed-rate loop since its start: quantiles, maximum, and the histogram they come from.

    `edges_us`: upper edges of its bins; `counts` has one more, of what was later than the last.
    """

    most_bytes: ClassVar[int] = 24 * 1024
    most_items: ClassVar[int] = 1024

    loop: Name
    ticks: NonNegativeInt
    missed: NonNegativeInt
    p50_us: Microseconds
    p99_us: Microseconds
    max_us: Microseconds
    edges_us: tuple[Microseconds, ...]
    counts: tuple[NonNegativeInt, ...]
    scheduling: ShortText


class ImpairmentTrace(Message):
    """Delays in ns that the impairment gave each message of a link: none = lost, two = doubled."""

    most_bytes: ClassVar[int] = 64 * 1024
    most_items: ClassVar[int] = 1024

    link: ShortText
    first_index: NonNegativeInt
    delays_ns: tuple[tuple[NonNegativeInt, ...], ...]
