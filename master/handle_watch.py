"""What the axis sees of its handle: one that fails is a handle that was let go."""

from collections.abc import Callable

from forefeel.common.errors import DeviceError
from forefeel.common.events.console import Notices
from forefeel.common.messages import MOST_POSITION_M, MOST_SECONDS, MOST_VELOCITY_M_S
from forefeel.master.handle import Handle, HandleReading


class HandleWatch:
    """Reads and renders; a fault releases the deadman at once and keeps it released until the re-arming.

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

    def read(self, now_ns: int) -> HandleReading:
        """The handle's reading; of one that has failed the last, at rest and let go."""
        had_failed = self.fault is not None
        try:
            if had_failed and not self._re_arm():
                return self._reading
            reading = _checked(self._handle.read(now_ns))
        except DeviceError as error:
            self._fail(error)
            return self._reading
        self._reading = reading._replace(velocity_m_s=0.0, deadman=False, recording_time_s=None, estop=False)
        return self._reading if had_failed else reading

    def render(self, force_n: float, now_ns: int) -> float:
        """The force as applied: 0 by a handle that has failed."""
        try:
            return self._handle.render(force_n, now_ns)
        except DeviceError as error:
            self._fail(error)
            return 0.0

    def _re_arm(self) -> bool:
        """Whether the person has done what it takes."""
        if not self._handle.pressed_anew:
            return False
        self._handle.rearm()
        self.fault = None
        self._notices.add("handle re-armed by the deadman")
        self._re_armed()
        return True

    def _fail(self, error: DeviceError) -> None:
        if self.fault is None:
            self.fault = str(error)
            self._notices.add(f"{self.fault}; let the deadman go and press it again to go on")


def _checked(reading: HandleReading) -> HandleReading:
    """Refuses, with DeviceError, what no message takes."""
    for name, value, most in (
        ("position_m", reading.position_m, MOST_POSITION_M),
        ("velocity_m_s", reading.velocity_m_s, MOST_VELOCITY_M_S),
        ("recording_time_s", reading.recording_time_s or 0.0, MOST_SECONDS),
    ):
        if not abs(value) <= most:
            raise DeviceError(f"handle: {name} = {value:g}: expected at most {most:g}")
    return reading
