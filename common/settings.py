"""Settings that both daemons have: the cell, the network, its impairment, real-time wishes, and the limits
that both must share.
"""

import hashlib
import json
from math import inf
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, ValidationInfo, model_validator

from forefeel.common.config import Settings, beside_the_file
from forefeel.common.errors import ConfigurationError, RecordingError
from forefeel.common.hardware.driver import SLOTS, DriverSettings, Slot
from forefeel.common.messages import MOST_FORCE_N, MOST_VELOCITY_M_S, PROTOCOL_VERSION, Position
from forefeel.common.recording.units import Mapping
from forefeel.common.topics import Role, checked_segment
from forefeel.common.transport.settings import ImpairmentSettings, TransportSettings


def _segment(text: str) -> str:
    try:
        return checked_segment(text, "name")
    except ConfigurationError as error:
        raise ValueError("expected one key segment without / * $ ? # or blanks") from error


def _existing(path: Path, info: ValidationInfo) -> Path:
    resolved = beside_the_file(path, info)
    if not resolved.is_file():
        raise ValueError("expected a file that exists (relative to this configuration file)")
    return resolved


Segment = Annotated[str, Field(min_length=1, max_length=64), AfterValidator(_segment)]
ExistingFile = Annotated[Path, AfterValidator(_existing)]


class ColumnSettings(Settings):
    """Columns of a table, each as `unit:column`, for example `mm:laser`; null: chosen by their names."""

    time: str | None = None
    position: str | None = None
    force: str | None = None
    rate_hz: float | None = None

    @model_validator(mode="after")
    def _units(self) -> "ColumnSettings":
        try:
            self.mapping()
        except RecordingError as error:
            raise ValueError(str(error)) from error
        return self

    def mapping(self) -> Mapping:
        return Mapping(self.time, self.position, self.force, self.rate_hz)


TICK_NS = 1_000_000
"""Period of the haptic loop and of the control loop: 1 kHz."""

LONGEST_ROUND_TRIP_S = 2.0
"""A session is opened up to this round trip, and no axis may be armed at more (`gate.max_round_trip_s`): the
hand has long gone on by then before it feels what it touched. An answer that takes longer counts as none."""


_WALL_PER_M = 1000.0


class AxisLimits(Settings):
    """Limits that the slave enforces on one axis and the master respects; equal on both ends or nothing arms.

    A rotation axis is described by its tangential equivalent: arc length in m and tangential force in N at
    the instrument's surface. `stiffest_wall_n_m`: of what the instrument may meet, drive and instrument
    included; the speed towards contact follows from it. Null: `max_force_n` within a millimetre.
    """

    kind: Literal["insertion", "rotation"] = "insertion"
    workspace_m: tuple[Position, Position] = (-0.002, 0.12)
    max_velocity_m_s: Annotated[float, Field(gt=0, le=MOST_VELOCITY_M_S)] = 0.2
    max_acceleration_m_s2: Annotated[float, Field(gt=0, le=1e7)] = 8.0
    max_force_n: Annotated[float, Field(gt=0, le=MOST_FORCE_N)] = 3.0
    stiffest_wall_n_m: Annotated[float, Field(gt=0, le=1e8)] | None = None

    @property
    def wall_n_m(self) -> float:
        return self.stiffest_wall_n_m or _WALL_PER_M * self.max_force_n

    @property
    def meaning(self) -> str:
        """Text, behind an axis's name, on what m and N are of a rotation; else empty."""
        return " (rotation: m of arc, N at the surface)" if self.kind == "rotation" else ""

    @model_validator(mode="after")
    def _ordered(self) -> "AxisLimits":
        if self.workspace_m[0] >= self.workspace_m[1]:
            raise ValueError(f"workspace_m = {list(self.workspace_m)}: expected [low, high] with low < high")
        return self


STOP_S, STOP_M = 0.25, 0.02
"""A person reacts to a light after 0.25 s: what is slower protects no better than their hand. At 0.08 m/s, a
brisk insertion, the instrument goes 0.02 m in that time."""
Bound = tuple[str, float, float, str]
"""Key of a setting in its axis, the range in which it protects (null there stands for infinity), and why."""


class AxisSettings(Settings):
    """Settings of an axis on both ends. `unsafe`: keys of its settings, such as `gate.lease_s`, that are
    meant to be beyond their bounds with a real stage or handle.
    """

    name: Segment = "insertion"
    limits: AxisLimits = AxisLimits()
    unsafe: tuple[str, ...] = ()

    @property
    def sections(self) -> dict[Slot, DriverSettings]:
        return {slot: getattr(self, slot) for slot in SLOTS if slot in type(self).model_fields}

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of other axes whose motion its contact model follows."""
        raise NotImplementedError

    @property
    def bounds(self) -> tuple[Bound, ...]:
        """Bounds of every setting that can switch a protection off."""
        raise NotImplementedError

    @property
    def caveats(self) -> tuple[str, ...]:
        """Lines on what is simulated, uncalibrated or `unsafe`, for whoever arms the axis or reads a run."""
        named: dict[str, list[str]] = {"no hardware": [], "uncalibrated": []}
        for slot, device in self.sections.items():
            if not device.hardware:
                named["no hardware"].append(f"{slot} ({device.driver})")
            elif getattr(device, "calibration", self) is None:
                named["uncalibrated"].append(slot)
        without = [f"{what}: {', '.join(slots)}"[:256] for what, slots in named.items() if slots]
        return (*without, *(f"unsafe: {key} = {attrgetter(key)(self)}" for key in dict.fromkeys(self.unsafe)))

    @model_validator(mode="after")
    def _check_bounds(self) -> Self:
        """Raises ValueError for a setting beyond its bound, if stage or handle is hardware and `unsafe` does
        not name it, and for a key in `unsafe` whose setting is not beyond its bound. Null counts as infinity.
        """
        real = any(self.sections[slot].hardware for slot in ("stage", "handle") if slot in self.sections)
        beyond = list[str]()
        for key, low, high, why in self.bounds:
            value = attrgetter(key)(self)
            if low <= (inf if value is None else value) <= high * (1.0 + 1e-9):  # 0.02 / 0.2 is less than 0.1
                continue
            beyond.append(key)
            if real and key not in self.unsafe:
                given, names = "null" if value is None else f"{value:g}", ", ".join((*self.unsafe, key))
                expected = f"{low:.3g} to {high:.3g} with hardware ({why}), or the line unsafe: [{names}]"
                raise ValueError(f"{key} = {given}: expected {expected}")
        if useless := sorted(set(self.unsafe).difference(beyond)):  # it would hide the next mistake
            names = ", ".join(beyond) or "none"
            raise ValueError(f"unsafe: {useless[0]!r:.80} is not beyond its bound: expected {names}")
        return self


class LinkImpairment(Settings):
    """Impairment of this daemon's traffic, by direction; for tests and demonstrations, none by default.

    `replay`: an MCAP of a run, whose impairment of this daemon's links is repeated message by message.
    """

    inbound: ImpairmentSettings = ImpairmentSettings()
    outbound: ImpairmentSettings = ImpairmentSettings()
    seed: int = 0
    replay: ExistingFile | None = None

    @model_validator(mode="after")
    def _one_of_them(self) -> "LinkImpairment":
        if self.replay is not None and not (self.inbound.transparent and self.outbound.transparent):
            raise ValueError(
                "replay: expected neither inbound nor outbound beside it, for it stands for both"
            )
        return self


class RealtimeSettings(Settings):
    """`priority` of SCHED_FIFO for the 1 kHz loop where the system permits it, 0 for normal scheduling;
    devices come 10 below it, everything else of the daemon 20.
    """

    priority: Annotated[int, Field(ge=0, le=90)] = 50

    @model_validator(mode="after")
    def _room_below(self) -> "RealtimeSettings":
        if 0 < self.priority <= 20:
            raise ValueError(f"priority = {self.priority}: expected 0, or 21 to 90")
        return self


class StateSettings(Settings):
    """Place of a daemon's event log, flight records and local socket, relative to this file.

    Without `directory`: STATE_DIRECTORY of systemd, else XDG_STATE_HOME/forefeel or ~/.local/state/forefeel,
    and in it CELL-ROLE. `flight_records`: how many of them are kept.
    """

    directory: Annotated[Path, AfterValidator(beside_the_file)] | None = None
    flight_records: Annotated[int, Field(ge=1, le=10_000)] = 20


class DaemonSettings(Settings):
    """Settings that master and slave have in common."""

    cell: Segment = "cell"
    transport: TransportSettings = TransportSettings()
    impairment: LinkImpairment = LinkImpairment()
    realtime: RealtimeSettings = RealtimeSettings()
    state: StateSettings = StateSettings()
    role: Role
    axes: tuple[AxisSettings, ...]

    @property
    def real_stage(self) -> bool:
        """True if a stage that is not simulated is configured; an emulated one counts as real."""
        return any("stage" in axis.sections and axis.sections["stage"].hardware for axis in self.axes)

    @model_validator(mode="after")
    def _distinct(self) -> Self:
        names = [axis.name for axis in self.axes]
        if len(set(names)) != len(names):
            raise ValueError(f"axes: names {names}: expected each name once")
        return self

    @model_validator(mode="after")
    def _check_columns(self) -> Self:
        """Raises ValueError where the contact model of an axis follows a column that is no other axis."""
        for axis in self.axes:
            others = [other.name for other in self.axes if other is not axis]
            for column in sorted(set(axis.columns) - set(others)):
                expected = f"another axis of the cell: {', '.join(others) or 'there is none'}"
                raise ValueError(f"axes: {axis.name}: column = {column!r} in its model: expected {expected}")
        return self


def shared_text(cell: str, axis: str, limits: AxisLimits) -> str:
    """Settings that both ends must agree on for one axis, as canonical JSON."""
    shared = {"protocol": PROTOCOL_VERSION, "cell": cell, "axis": axis, **limits.model_dump(mode="json")}
    return json.dumps(shared, sort_keys=True)


def settings_hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def differences(mine: str, theirs: str) -> str:
    """Text on the fields in which two `shared_text`s differ, one line of 200 characters at most; empty: none.
    Where the protocol versions differ it names only these. `theirs` comes from the network, may be anything.
    """
    try:
        other = json.loads(theirs)
    except (ValueError, RecursionError):
        other = None
    if not isinstance(other, dict):
        return "the peer's settings are unreadable"
    ours = json.loads(mine)
    fields = [
        f"{key}: {ours.get(key)} here, {other.get(key)} there"
        for key in sorted({*ours, *other})
        if ours.get(key) != other.get(key)
    ]
    if ours["protocol"] != (spoken := other.get("protocol")):
        versions = f"protocol: {ours['protocol']} here, {spoken} there"
        fields = [f"{versions}: install the same version of forefeel on both hosts"]
    return ascii("; ".join(fields))[1:-1][:200]  # what the peer sent may hold line breaks and half characters
