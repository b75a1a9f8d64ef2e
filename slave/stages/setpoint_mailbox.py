"""What the control loop wants of a drive that another thread talks to."""

from threading import Lock

from forefeel.slave.stages.setpoint import Wanted


class SetpointMailbox:
    """The newest setpoint, or hold. A hold goes before every setpoint until the drive has acknowledged it.

    Attributes:
        superseded: setpoints that a newer one replaced before the drive was sent there.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._setpoint: Wanted | None = None
        self._stop_due = self._new = False
        self.superseded = 0

    def command(self, setpoint: Wanted) -> None:
        """The newest setpoint."""
        with self._lock:
            self.superseded += self._new
            self._setpoint, self._new = setpoint, True

    def hold(self) -> None:
        """Forgets the setpoint; the drive is to be stopped if it had been given one."""
        with self._lock:
            self._stop_due = self._stop_due or self._setpoint is not None
            self._setpoint, self._new = None, False

    def now(self) -> tuple[bool, Wanted | None]:
        """(whether a stop is due, the newest setpoint; None: hold)."""
        with self._lock:
            self._new = False
            return self._stop_due, self._setpoint

    def stopped(self) -> None:
        """The drive has acknowledged the stop. No setpoint was sent since it was."""
        with self._lock:
            self._stop_due = False
