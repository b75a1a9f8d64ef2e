"""What one cycle of a CiA 402 drive that is being homed decides. Pure."""

from forefeel.common.errors import DeviceError
from forefeel.common.hardware.cia402 import (
    HERE,
    HOMING_ATTAINED,
    HOMING_ERROR,
    HOMING_START,
    TARGET_REACHED,
    Phase,
)
from forefeel.slave.stages.drive_cycle import DriveCycle, Readback

_STAND_CYCLES = 3
_ANSWER_CYCLES = 3
_STATUS = HOMING_ERROR | HOMING_ATTAINED | TARGET_REACHED


class HomingCycle:
    """Enables the drive, begins to home, and sees how it ends.

    A drive may show that it is homed from the last time, until it has taken the start: where something has to
    move, `done` needs a statusword that said it was not.

    Args:
        cycle: what supervises the drive; its setpoint stays where the drive is.
        method: of 6098.
        patience: so many cycles the way may take.

    Attributes:
        done: whether the reference has been found, and the drive is at rest.
    """

    def __init__(self, cycle: DriveCycle, method: int, patience: int) -> None:
        self.done = False
        self._cycle, self._left = cycle, patience
        self._begun = method in HERE
        self._moving = False
        self._started = 0

    def step(self, heard: Readback | None, beat: bool, emergency: int | None) -> int:
        """The controlword; `heard`, `beat`, `emergency`: since the last cycle.

        Raises:
            DeviceError: a fault of the drive or of the way to it, an error or an end of homing, or it takes
                too long.
        """
        machine = self._cycle.machine
        word = self._cycle.supervise(heard, beat, emergency)
        if heard is not None:
            self._cycle.setpoint.restart(heard.position_m)
            self._cycle.passive_cycles += machine.phase is Phase.PASSIVE
        if machine.phase is not Phase.FOLLOWING:
            if self._cycle.passive_cycles >= _STAND_CYCLES:
                machine.enable()
            return word
        if self._started and heard is not None:
            self._started += 1
            self._judge(heard.statusword)
        self._started = self._started or 1
        self._left -= 1
        if self._left < 0 and not self.done:
            raise DeviceError("homing takes too long")
        return word | HOMING_START

    def _judge(self, statusword: int) -> None:
        status = statusword & _STATUS
        self._begun = self._begun or not status & HOMING_ATTAINED
        self._moving = self._moving or status == 0
        if self._started <= _ANSWER_CYCLES:
            return
        if status & HOMING_ERROR:
            raise DeviceError(f"the drive reports an error of homing (statusword {statusword:04X})")
        if status == TARGET_REACHED and self._moving:
            raise DeviceError(f"homing was interrupted (statusword {statusword:04X})")
        self.done = self._begun and status == HOMING_ATTAINED | TARGET_REACHED
