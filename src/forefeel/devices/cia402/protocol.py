"""Drives after CiA 402: objects, statusword, and the state machine of the one who commands. Pure."""

from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType

from forefeel.common.errors import DeviceError
from forefeel.devices.canopen.cia301 import ObjectEntry

PROFILE = 402  # device profile, the lower half of object 1000
CSP = 8  # mode of operation: cyclic synchronous position (CiA 402)
CSP_SUPPORTED = 1 << (CSP - 1)
HOMING = 6  # mode of operation: homing (CiA 402)
HOMING_SUPPORTED = 1 << (HOMING - 1)

ABORT_OPTION = ObjectEntry(0x6007, 0, "h")
ERROR_CODE = ObjectEntry(0x603F, 0, "H")
CONTROLWORD = ObjectEntry(0x6040, 0, "H")
STATUSWORD = ObjectEntry(0x6041, 0, "H")
QUICK_STOP_OPTION = ObjectEntry(0x605A, 0, "h")
MODE, MODE_DISPLAY = ObjectEntry(0x6060, 0, "b"), ObjectEntry(0x6061, 0, "b")
POSITION_ACTUAL = ObjectEntry(0x6064, 0, "i")
FOLLOWING_WINDOW, FOLLOWING_TIMEOUT_MS = ObjectEntry(0x6065, 0, "I"), ObjectEntry(0x6066, 0, "H")
TARGET_POSITION = ObjectEntry(0x607A, 0, "i")
HOME_OFFSET = ObjectEntry(0x607C, 0, "i")
SOFT_LIMIT_LOW, SOFT_LIMIT_HIGH = ObjectEntry(0x607D, 1, "i"), ObjectEntry(0x607D, 2, "i")
PERIOD_VALUE, PERIOD_EXPONENT = ObjectEntry(0x60C2, 1, "B"), ObjectEntry(0x60C2, 2, "b")
HOMING_METHOD = ObjectEntry(0x6098, 0, "b")
HOMING_SEARCH_SPEED, HOMING_ZERO_SPEED = ObjectEntry(0x6099, 1, "I"), ObjectEntry(0x6099, 2, "I")
HOMING_ACCELERATION = ObjectEntry(0x609A, 0, "I")
SUPPORTED_MODES = ObjectEntry(0x6502, 0, "I")

ABORT_QUICK_STOP = 3  # 6007: a lost heartbeat is a quick stop, after which no fault need be reset (CiA 402)
STAY_IN_QUICK_STOP = 6  # 605A: slows down on the quick-stop ramp, then holds in QUICK_STOP_ACTIVE (CiA 402)

# commands in the controlword, bits 0 to 3 (CiA 402)
DISABLE_VOLTAGE, QUICK_STOP, SHUTDOWN, SWITCH_ON, ENABLE = 0x00, 0x02, 0x06, 0x07, 0x0F
FAULT_RESET = 0x80  # bit 7 of the controlword: its rising edge resets a fault (CiA 402)

NEGATIVE_SWITCH, POSITIVE_SWITCH = (
    17,
    18,
)  # 6098: onto that limit switch and off it; its edge is the reference
HERE = frozenset({35, 37})  # 6098: where it stands is the reference; nothing moves (CiA 402)
HALT = 1 << 8  # bit of the controlword: interrupts a motion (CiA 402)
HOMING_START = 1 << 4  # controlword in the mode of homing: the rising edge begins, it ends when the bit falls
TARGET_REACHED, HOMING_ATTAINED, HOMING_ERROR = 1 << 10, 1 << 12, 1 << 13
"""Statusword in the mode of homing; none of them: under way; the first alone: interrupted, or not begun."""


class DriveState(Enum):
    NOT_READY = "not ready to switch on"
    DISABLED = "switch on disabled"
    READY = "ready to switch on"
    SWITCHED_ON = "switched on"
    ENABLED = "operation enabled"
    QUICK_STOP = "quick stop active"
    FAULT_REACTION = "fault reaction active"
    FAULT = "fault"


PATTERNS: Mapping[DriveState, tuple[int, int]] = MappingProxyType(
    {
        DriveState.NOT_READY: (0x4F, 0x00),
        DriveState.DISABLED: (0x4F, 0x40),
        DriveState.READY: (0x6F, 0x21),
        DriveState.SWITCHED_ON: (0x6F, 0x23),
        DriveState.ENABLED: (0x6F, 0x27),
        DriveState.QUICK_STOP: (0x6F, 0x07),
        DriveState.FAULT_REACTION: (0x4F, 0x0F),
        DriveState.FAULT: (0x4F, 0x08),
    }
)
"""Statusword: mask and bits of each state."""


def drive_state(statusword: int) -> DriveState | None:
    """State that a statusword shows; None: its bits match none."""
    for state, (mask, bits) in PATTERNS.items():
        if statusword & mask == bits:
            return state
    return None


def interpolation_period(rate_hz: int) -> tuple[int, int] | None:
    """(value, exponent) of 60C2 for 1 / rate, in ms or tenths of it; None where neither expresses it."""
    for exponent in (-3, -4):
        value, rest = divmod(10**-exponent, rate_hz)
        if rest == 0 and 1 <= value <= 255:
            return value, exponent
    return None


class Phase(Enum):
    PASSIVE = "passive"
    RESETTING = "resetting"
    ENABLING = "enabling"
    FOLLOWING = "following"


_TOWARDS_ENABLED = {
    DriveState.NOT_READY: DISABLE_VOLTAGE,
    DriveState.DISABLED: SHUTDOWN,
    DriveState.READY: SWITCH_ON,
    DriveState.SWITCHED_ON: ENABLE,
    DriveState.ENABLED: ENABLE,
    DriveState.QUICK_STOP: DISABLE_VOLTAGE,
}


class DriveMachine:
    """State machine that answers every statusword with a controlword.

    It starts passive: quick stop. `enable` leads a drive without fault to OPERATION ENABLED; only `rearm`
    resets a fault, with one rising edge of bit 7. Any other state than the expected one makes it passive
    again, for good: it never leaves a fault by itself.

    Args:
        patience: cycles that a reset or an enabling may take.
    """

    def __init__(self, patience: int) -> None:
        self.phase = Phase.PASSIVE
        self._patience, self._left = patience, 0
        self._bit_7_was_low = False

    def enable(self) -> None:
        self._begin(Phase.ENABLING)

    def rearm(self) -> None:
        """Resets a fault if there is one, then enables; nothing unless PASSIVE."""
        self._begin(Phase.RESETTING)

    def stop(self) -> None:
        """Answers every statusword with quick stop from now on."""
        self.phase = Phase.PASSIVE

    def step(self, statusword: int) -> int:
        """The controlword that answers this statusword. DeviceError: the drive is not where it ought to be;
        the machine is passive from now on.
        """
        word = self._word(drive_state(statusword), statusword)
        self._bit_7_was_low = not word & FAULT_RESET
        return word

    def _begin(self, phase: Phase) -> None:
        if self.phase is Phase.PASSIVE:
            self.phase, self._left = phase, self._patience

    def _word(self, state: DriveState | None, statusword: int) -> int:
        """Returns the controlword that answers this state, and moves the phase on: reset, enable, follow.
        While passive it is a quick stop. DeviceError: the drive is in no expected state, or stays in one for
        too long; passive from then on.
        """
        if self.phase is Phase.PASSIVE:
            return QUICK_STOP
        if self.phase is Phase.RESETTING:
            if state in (DriveState.FAULT, DriveState.FAULT_REACTION, None):
                self._wait(state)
                return FAULT_RESET if state is DriveState.FAULT and self._bit_7_was_low else QUICK_STOP
            self.phase = Phase.ENABLING
        self._expect(state in _TOWARDS_ENABLED, state, statusword)
        assert state is not None
        if self.phase is Phase.FOLLOWING:
            self._expect(state is DriveState.ENABLED, state, statusword)
        elif state is DriveState.ENABLED:
            self.phase = Phase.FOLLOWING
        else:
            self._wait(state)
        return _TOWARDS_ENABLED[state]

    def _wait(self, state: DriveState | None) -> None:
        self._left -= 1
        if self._left < 0:
            self.phase = Phase.PASSIVE
            raise DeviceError(f"drive stays in '{state.value if state else 'no known state'}'")

    def _expect(self, as_it_must: bool, state: DriveState | None, statusword: int) -> None:
        if as_it_must:
            return
        phase, self.phase = self.phase, Phase.PASSIVE
        actual = f"'{state.value}'" if state else f"no known state (statusword {statusword:04X})"
        raise DeviceError(f"drive in {actual} while {phase.value}")
