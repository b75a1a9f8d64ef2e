"""A CiA 402 drive in the modes of cyclic synchronous position and homing on any python-can bus."""

import time
from collections.abc import Callable

import can
import canopen

from forefeel.common.hardware import cia301, cia402
from forefeel.common.hardware.cia301 import ObjectEntry
from forefeel.emulate.canopen_device import CanopenDevice, pdo_contents, unpacked
from forefeel.emulate.drive402_homing import METHODS
from forefeel.emulate.drive402_model import HEARTBEAT_LOST, OVERCURRENT, DriveModel, Moved
from forefeel.slave.plant.settings import StageSettings

SERIAL = 0x0402_0001
_INVALID = 0x0609_0030  # value of a parameter
_SHOWN = {
    cia402.STATUSWORD.index: "statusword",
    cia402.POSITION_ACTUAL.index: "position",
    cia402.VELOCITY_ACTUAL.index: "velocity",
    cia402.MODE_DISPLAY.index: "mode",
    cia402.ERROR_CODE.index: "error_code",
    cia402.FOLLOWING_ERROR.index: "following_error",
}
_SIGNED = frozenset(
    {(0x6007, 0), (0x607C, 0), (0x6098, 0), (0x605A, 0), (0x607D, 1), (0x607D, 2), (0x60C2, 2)}
)


def contents(node: int) -> dict[ObjectEntry, float]:
    """The object dictionary of the drive."""
    return {
        cia301.DEVICE_TYPE: 0x0002_0000 | cia402.PROFILE,  # a servo drive
        cia301.ERROR_REGISTER: 0,
        cia301.SYNC_PERIOD_US: 0,
        ObjectEntry(0x1016, 0, "B"): 1,
        cia301.HEARTBEAT_CONSUMER: 0,
        cia301.HEARTBEAT_PRODUCER_MS: 0,
        ObjectEntry(0x1018, 0, "B"): 4,
        cia301.VENDOR: 0x0000_FEE1,
        cia301.PRODUCT: 0x402,
        cia301.REVISION: 0x0001_0000,
        cia301.SERIAL: SERIAL,
        **pdo_contents(node),
        cia402.ABORT_OPTION: 1,
        cia402.ERROR_CODE: 0,
        cia402.CONTROLWORD: 0,
        cia402.STATUSWORD: 0,
        cia402.QUICK_STOP_OPTION: 2,
        cia402.MODE: 0,
        cia402.MODE_DISPLAY: 0,
        cia402.POSITION_ACTUAL: 0,
        cia402.FOLLOWING_WINDOW: 2**31,
        cia402.FOLLOWING_TIMEOUT_MS: 0,
        cia402.VELOCITY_ACTUAL: 0,
        cia402.TARGET_POSITION: 0,
        ObjectEntry(0x607D, 0, "B"): 2,
        cia402.HOME_OFFSET: 0,
        cia402.SOFT_LIMIT_LOW: -(2**31),
        cia402.SOFT_LIMIT_HIGH: 2**31 - 1,
        cia402.QUICK_STOP_DECELERATION: 0,
        ObjectEntry(0x60C2, 0, "B"): 2,
        cia402.PERIOD_VALUE: 4,
        cia402.PERIOD_EXPONENT: -3,
        cia402.HOMING_METHOD: 0,
        ObjectEntry(0x6099, 0, "B"): 2,
        cia402.HOMING_SEARCH_SPEED: 0,
        cia402.HOMING_ZERO_SPEED: 0,
        cia402.HOMING_ACCELERATION: 0,
        cia402.FOLLOWING_ERROR: 0,
        cia402.SUPPORTED_MODES: cia402.CSP_SUPPORTED | cia402.HOMING_SUPPORTED,
    }


class Drive402(CanopenDevice):
    """The drive: run `step` over and over in one thread.

    Args:
        bus: an open bus of its own.
        node: its identifier.
        settings: the mechanics.
        counts_per_m: of its encoder.
        moved: called at every step of the servo (t_s, x_m, v_m_s, a_m_s2).
        rate_hz: of the servo.
        now_s: a clock.

    Attributes:
        model: the drive behind the bus.
    """

    faults = "unplug", "plug", "drive_fault", "stuck", "no_switch", "free"

    def __init__(
        self,
        bus: can.BusABC,
        node: int,
        settings: StageSettings,
        counts_per_m: float,
        moved: Moved | None = None,
        rate_hz: int = 2000,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self.model = DriveModel(settings, counts_per_m, rate_hz, moved)
        self._counts_per_m = counts_per_m
        self._listens_to, self._silence_s = 0, 0.0
        self._last_beat_s: float | None = None
        super().__init__(bus, node, contents(node), now_s)

    def provoke(self, fault: str) -> None:
        """`drive_fault`: overcurrent, for a reset to clear; `stuck` or `no_switch` (no limit switch answers)
        until `free`; `unplug` and `plug`.
        """
        if fault == "drive_fault":
            self.model.fail(OVERCURRENT)
        elif fault in ("stuck", "free"):
            self.model.stuck, self.model.homing.no_switch = fault == "stuck", False
        elif fault == "no_switch":
            self.model.homing.no_switch = True
        else:
            super().provoke(fault)

    def written(self, index: int, sub: int, value: bytes) -> None:
        """See `CanopenDevice`."""
        model = self.model
        if index == cia402.CONTROLWORD.index:
            model.control(unpacked(cia402.CONTROLWORD, value))
        elif index == cia402.TARGET_POSITION.index:
            model.target(unpacked(cia402.TARGET_POSITION, value))
        elif index == cia402.MODE.index:
            model.mode = unpacked(cia402.MODE, value)
        elif (index, sub) == (0x1016, 1):
            word = unpacked(cia301.HEARTBEAT_CONSUMER, value)
            self._listens_to, self._silence_s = word >> 16 & 0x7F, (word & 0xFFFF) * 1e-3
            self._last_beat_s = None
        else:
            self._configured((index, sub), value)

    def shown(self, index: int, sub: int) -> float | None:
        """See `CanopenDevice`."""
        del sub
        name = _SHOWN.get(index)
        return None if name is None else int(getattr(self.model, name))

    def synchronised(self, t_s: float) -> None:
        """See `CanopenDevice`."""
        self.model.sync(t_s)

    def heard(self, can_id: int, t_s: float) -> None:
        """See `CanopenDevice`."""
        if can_id == cia301.HEARTBEAT + self._listens_to and self._silence_s:
            self._last_beat_s = t_s

    def left_operational(self) -> None:
        """See `CanopenDevice`."""
        self.model.lose_host()

    def live(self, t_s: float) -> None:
        """See `CanopenDevice`; the host is lost when its heartbeat, once heard, stays away."""
        if self._last_beat_s is not None and t_s - self._last_beat_s > self._silence_s:
            self.model.advance(self._last_beat_s + self._silence_s)
            self._last_beat_s = None
            self.model.lose_host()
            self.model.alarms.append(HEARTBEAT_LOST)
            self.enter_preoperational()
        self.model.advance(t_s)
        for code in self.model.alarms:
            self.report(code)
        self.model.alarms.clear()

    def _configured(self, at: tuple[int, int], value: bytes) -> None:
        model, number = self.model, int.from_bytes(value, "little", signed=at in _SIGNED)
        match at:
            case (0x6007, 0):
                model.abort_option = number
            case (0x605A, 0):
                model.quick_stop_option = number
            case (0x6065, 0):
                model.window = number
            case (0x6066, 0):
                model.timeout_s = number * 1e-3
            case (0x607D, 1):
                model.soft_limits = number, model.soft_limits[1]
            case (0x607D, 2):
                model.soft_limits = model.soft_limits[0], number
            case (0x60C2, 1):
                model.period_s = number * 10.0 ** self.value(cia402.PERIOD_EXPONENT)
            case (0x60C2, 2):
                model.period_s = self.value(cia402.PERIOD_VALUE) * 10.0**number
            case _:
                self._homed_by(at, number)

    def _homed_by(self, at: tuple[int, int], number: int) -> None:
        homing, metres = self.model.homing, number / self._counts_per_m
        match at:
            case (0x607C, 0):
                self.model.home_offset = number
            case (0x6098, 0) if number not in METHODS:
                raise canopen.SdoAbortedError(_INVALID)
            case (0x6098, 0):
                homing.method = number
            case (0x6099, 1):
                homing.search_m_s = metres
            case (0x6099, 2):
                homing.zero_m_s = metres
            case (0x609A, 0):
                homing.acceleration_m_s2 = metres
