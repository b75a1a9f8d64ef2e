"""The handle port: what the master needs of the thing in the surgeon's hand; and how an axis reads it."""

from collections.abc import Callable, Mapping
from typing import Annotated, ClassVar, NamedTuple, Protocol

from pydantic import Field

from forefeel.common.errors import DeviceError
from forefeel.common.events.console import Notices
from forefeel.common.hardware.driver import DriverSettings, Slot
from forefeel.common.messages import (
    MOST_POSITION_M,
    MOST_SECONDS,
    MOST_VELOCITY_M_S,
    Grip,
    SafetyState,
)
from forefeel.master.polarity import PolarityCheck


class HandleDriverSettings(DriverSettings):
    """`actuator_delay_s`: the longest time in s from `render` to the force at the hand; a longer one that the
    device reports counts instead. The force gives the hand no energy unless it is later by over 1 ms.
    """

    slot: ClassVar[Slot] = "handle"
    actuator_delay_s: Annotated[float, Field(ge=0, le=0.02)] = 0.0


class HandleReading(NamedTuple):
    """Position of the handle and what is pressed. `recording_time_s`: time in the recording that is being
    played, if one is. `estop`: the handle has a button for the emergency stop, and it is pressed.
    """

    position_m: float
    velocity_m_s: float
    deadman: bool
    gripper: Grip = Grip.CLOSED
    recording_time_s: float | None = None
    estop: bool = False


class Indication(NamedTuple):
    """State of the slave (None: no link) and position of its stage, for the person."""

    state: SafetyState | None
    stage_position_m: float | None


class Handle(Protocol):
    """Read and rendered once per haptic tick; neither call blocks.

    A handle that fails raises DeviceError from `read` and `render` until it is re-armed, and gives no force.
    """

    def open(self) -> None:
        """Connects. Raises DeviceError when the handle does not answer."""
        ...

    def close(self) -> None:
        """Takes the force away and lets go; idempotent."""
        ...

    def rearm(self) -> None:
        """Makes the handle give force again after a fault. Raises DeviceError while it does not answer."""
        ...

    @property
    def pressed_anew(self) -> bool:
        """True when the handle answers again after a fault, and the deadman was let go and pressed since."""
        ...

    @property
    def counters(self) -> Mapping[str, int]:
        """Counts of the handle's link, by name."""
        ...

    @property
    def actuator_delay_s(self) -> float:
        """Longest time from `render` to the force, as the open device says it; 0 where it says nothing."""
        ...

    def read(self, now_ns: int) -> HandleReading:
        """Position (m, positive inserts), velocity and buttons now. Raises DeviceError, see above."""
        ...

    def render(self, force_n: float, now_ns: int) -> float:
        """Applies a force to the hand (positive resists insertion); returns it as applied."""
        ...

    def show(self, indication: Indication) -> None: ...

    @property
    def finished(self) -> bool:
        """True when a motion that ends by itself has ended."""
        ...

    @property
    def clutched_out_s(self) -> float:
        """Time in s that the person chose to spend with the clutch open."""
        ...


_REVERSED = (
    "handle = motor reversed: it pushes the hand along where it should resist; "
    "expected the wires of its motor exchanged, and a new start"
)


class HandleWatch:
    """Reads and renders a handle. A fault releases the deadman at once and keeps it released until the handle
    is re-armed; a motor that is reversed is a fault that stays.

    The person re-arms: lets the deadman go and presses it again once the handle answers. `re_armed` is called
    then, and the reading of that tick still has the deadman released: from it the clutch takes where the hand
    is now, so that nothing jumps.

    Attributes:
        fault: why the handle has failed; None while it works.
    """

    def __init__(self, handle: Handle, notices: Notices, re_armed: Callable[[], None]) -> None:
        self.fault: str | None = None
        self._handle, self._notices, self._re_armed = handle, notices, re_armed
        self._reading = HandleReading(0.0, 0.0, False)
        self._polarity = PolarityCheck()

    def read(self, now_ns: int) -> HandleReading:
        """Returns the handle's reading. A DeviceError, or a reading out of range, sets `fault`; from then on
        returns the last position at rest with the deadman released. Re-arms, except after a reversed motor,
        once the person has pressed the deadman anew; the reading of that tick still has it released. A handle
        that answers has its button for the emergency stop in every reading, whatever else is wrong.
        """
        had_failed, estop = self.fault is not None, False
        try:
            works = not had_failed or self._re_arm()
            reading = self._handle.read(now_ns)
            estop = reading.estop
            if works:
                self._reading = _checked(reading)
        except DeviceError as error:
            self._fail(error)
        if had_failed or self.fault is not None:
            return HandleReading(self._reading.position_m, 0.0, False, self._reading.gripper, estop=estop)
        return self._reading

    def render(self, force_n: float, now_ns: int) -> float:
        """Applies a force to the hand, 0 while `fault` is set; returns the force as the handle applied it. A
        DeviceError sets `fault` and returns 0; a motor that is found to be reversed sets `fault`, too, but
        not while a recording is played.
        """
        try:
            applied_n = self._handle.render(force_n if self.fault is None else 0.0, now_ns)
        except DeviceError as error:
            self._fail(error)
            return 0.0
        played = self._reading.recording_time_s is not None  # no force moves that hand
        if (
            self.fault is None
            and not played
            and self._polarity.is_reversed(self._reading.position_m, applied_n)
        ):
            self.fault = _REVERSED
            self._notices.add(_REVERSED)
        return applied_n

    def _re_arm(self) -> bool:
        """Re-arms the handle if the person pressed the deadman anew: clears `fault`, adds a notice, calls
        `re_armed`; True then. False if not pressed, for a reversed motor, or if the handle refuses.
        """
        if self.fault == _REVERSED or not self._handle.pressed_anew:
            return False
        try:
            self._handle.rearm()
        except DeviceError:
            return False
        self.fault = None
        self._notices.add("handle re-armed by the deadman")
        self._re_armed()
        return True

    def _fail(self, error: DeviceError) -> None:
        if self.fault is None:
            self.fault = str(error)
            self._notices.add(f"{self.fault}; let the deadman go and press it again to go on")


def _checked(reading: HandleReading) -> HandleReading:
    """Returns the reading as it is; raises DeviceError where position, velocity or recording time is NaN or
    beyond the range of the messages.
    """
    x_m, v_m_s, time_s = reading.position_m, reading.velocity_m_s, reading.recording_time_s or 0.0
    if abs(x_m) <= MOST_POSITION_M and abs(v_m_s) <= MOST_VELOCITY_M_S and abs(time_s) <= MOST_SECONDS:
        return reading
    raise DeviceError(
        f"handle = ({x_m:g} m, {v_m_s:g} m/s, recording {time_s:g} s): expected at most "
        f"{MOST_POSITION_M:g} m, {MOST_VELOCITY_M_S:g} m/s and {MOST_SECONDS:g} s"
    )
