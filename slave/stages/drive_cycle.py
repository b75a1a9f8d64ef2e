"""What one cycle of a CiA 402 drive decides: controlword and setpoint out of what was heard. Pure."""

from collections import Counter, deque
from typing import NamedTuple

from forefeel.common.errors import DeviceError
from forefeel.common.hardware.cia402 import QUICK_STOP, DriveMachine, Phase
from forefeel.slave.stages.setpoint import Setpoint, Wanted

SILENT_PERIODS, SILENT_S = 3, 0.05
"""So many SYNC in a row without a TPDO, and for so long, are a fault: a host pauses for more than 12 ms."""
_FIRST_TPDO_S = 0.5
_ENABLE_S = 1.0
_BEHIND_CYCLES = 5
_REMEMBERED = 4
_STREAM_S = 0.060
_CARRY_S = 0.002


class Readback(NamedTuple):
    """What a TPDO says: when it came, the statusword, where the drive is and how fast."""

    host_ns: int
    statusword: int
    position_m: float
    velocity_m_s: float


class Tracker:
    """Velocity from positions at SYNC, and whether they can be true.

    A frame on a wire without a checksum may say anything: a position further from the last than the drive
    can go counts as not received.

    Attributes:
        counts: `implausible`.
    """

    def __init__(self, period_s: float, max_velocity_m_s: float, following_error_m: float) -> None:
        self._period_s, self._fastest_m_s, self._slack_m = period_s, max_velocity_m_s, following_error_m
        self._last: Readback | None = None
        self.counts: Counter[str] = Counter()

    def take(self, host_ns: int, statusword: int, position_m: float) -> Readback | None:
        """The readback of a TPDO; None: it can not be believed."""
        velocity_m_s = 0.0
        if self._last is not None:
            periods = max(1, round((host_ns - self._last.host_ns) * 1e-9 / self._period_s))
            went_m, elapsed_s = position_m - self._last.position_m, periods * self._period_s
            if abs(went_m) > 2.0 * self._fastest_m_s * elapsed_s + self._slack_m:
                self.counts["implausible"] += 1
                return None
            velocity_m_s = went_m / elapsed_s
        self._last = Readback(host_ns, statusword, position_m, velocity_m_s)
        return self._last


class DriveCycle:
    """Supervises and commands, once for each SYNC.

    Args:
        period_s: of SYNC.
        heartbeat_s: how often the drive is to say that it lives.
        following_error_m: how far it may stay behind the setpoint.
        setpoint: what it is led by; starts where the drive is.

    Attributes:
        passive_cycles: how often the drive has answered while it was told to stand.
    """

    def __init__(
        self, period_s: float, heartbeat_s: float, following_error_m: float, setpoint: Setpoint
    ) -> None:
        self._period_s = period_s
        self._window_m = following_error_m
        self.machine = DriveMachine(patience=round(_ENABLE_S / period_s))
        self.setpoint = setpoint
        self._beat_cycles = int(3.0 * heartbeat_s / period_s) + 1
        self._no_beat = self._silent = self._behind = 0
        self._patience = max(SILENT_PERIODS, round(SILENT_S / period_s))
        self._grace = round(_FIRST_TPDO_S / period_s)
        self._heard_once = False
        self._sent: deque[float] = deque(maxlen=_REMEMBERED)
        self._statusword = 0
        self.passive_cycles = 0

    def step(
        self, heard: Readback | None, beat: bool, emergency: int | None, wanted: Wanted | None, now_ns: int
    ) -> int:
        """The controlword; `setpoint.position_m` is the target beside it.

        `heard`, `beat`, `emergency`: since the last cycle; `wanted`: None to hold.

        Raises:
            DeviceError: a fault of the drive or of the way to it.
        """
        following = self.machine.phase is Phase.FOLLOWING
        word = self.supervise(heard, beat, emergency)
        if not following:
            if heard is not None:
                self.setpoint.restart(heard.position_m)
                self.passive_cycles += self.machine.phase is Phase.PASSIVE
            self._sent.clear()
            return word
        self._move(wanted, now_ns)
        if heard is not None:
            self._not_behind(heard.position_m)
        self._sent.append(self.setpoint.position_m)
        return word

    def supervise(self, heard: Readback | None, beat: bool, emergency: int | None) -> int:
        """The controlword alone, for a drive that moves by itself.

        Raises:
            DeviceError: as `step`, but for the following error, which is the drive's own to watch.
        """
        self._listen(heard, beat, emergency)
        return self.machine.step(self._statusword) if self._heard_once else QUICK_STOP

    def _listen(self, heard: Readback | None, beat: bool, emergency: int | None) -> None:
        self._no_beat = 0 if beat else self._no_beat + 1
        self._silent = 0 if heard else self._silent + 1
        if heard is not None:
            self._statusword, self._heard_once = heard.statusword, True
        if emergency and self.machine.phase is not Phase.PASSIVE:
            raise DeviceError(f"drive reports emergency {emergency:04X}")
        if self._silent > (self._patience if self._heard_once else self._grace):
            raise DeviceError(f"no TPDO of the drive for {self._silent - 1} SYNC periods")
        if self._no_beat > max(self._beat_cycles, 0 if self._heard_once else self._grace):
            raise DeviceError("no heartbeat of the drive for three of its periods")

    def _move(self, wanted: Wanted | None, now_ns: int) -> None:
        age_s = 0.0 if wanted is None else max(0.0, (now_ns - wanted.stamp_ns) * 1e-9)
        if wanted is None or age_s > _STREAM_S:
            self.setpoint.hold()
        else:
            self.setpoint.follow(wanted.position_m + wanted.velocity_m_s * min(age_s, _CARRY_S))

    def _not_behind(self, actual_m: float) -> None:
        """A drive answers a setpoint one or two cycles later: any of the last few will do."""
        if not self._sent:
            return
        error_m = max(min(self._sent) - actual_m, actual_m - max(self._sent), 0.0)
        self._behind = self._behind + 1 if error_m > self._window_m else 0
        if self._behind >= _BEHIND_CYCLES:
            raise DeviceError(
                f"following error {error_m:.4g} m at {actual_m:.4g} m, expected at most {self._window_m:g} m"
            )
