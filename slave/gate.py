"""Admission of commands: session, sequence, age, range. Pure; runs in the thread that received the command.

What each of them is against: docs/explanation/safety.md.
"""

from dataclasses import dataclass
from typing import NamedTuple

from forefeel.common.clock_offset import OffsetEstimate
from forefeel.common.messages import MotionCommand

SECOND_WRITER = "second_writer"
_GAPS = 64  # of the numbers that came, remembered


class Refusal(NamedTuple):
    """Refusal of a command: the rule, what was asked and the limit, with its unit."""

    rule: str
    requested: float
    limit: float
    unit: str


@dataclass(frozen=True, slots=True)
class GateLimits:
    """`max_age_ns`: by how much a command may be slower than the fastest, see `forefeel.common.clock_offset`;
    `position_m`, `velocity_m_s`: what is plausible at all (limits proper come later).
    """

    max_age_ns: int
    position_m: tuple[float, float]
    velocity_m_s: float


class _Window:
    """Numbers of the commands of one session: the newest, and those that were left out before it."""

    def __init__(self, session_id: int) -> None:
        self.session_id = session_id
        self.sequence = 0
        self._stamp_ns = 0
        self._skipped: list[tuple[int, int]] = []

    def is_of_another_writer(self, command: MotionCommand) -> bool:
        """True for a command that comes too late by its number, but was stamped after the newest, under a
        number that nobody has used: then one of two writers has jumped ahead.
        """
        return command.stamp_ns > self._stamp_ns and any(
            first <= command.sequence <= last for first, last in self._skipped
        )

    def move(self, command: MotionCommand) -> None:
        if 0 < self.sequence < command.sequence - 1:
            self._skipped = [*self._skipped[1 - _GAPS :], (self.sequence + 1, command.sequence - 1)]
        self.sequence, self._stamp_ns = command.sequence, command.stamp_ns


class CommandGate:
    """Admits each command at most once, in order, fresh, from the session that holds the lease."""

    def __init__(self, limits: GateLimits) -> None:
        self._limits = limits
        self._window: _Window | None = None

    def open(self, session_id: int) -> None:
        """Begins the sequence afresh for a new session. Only a handshake leads here."""
        self._window = _Window(session_id)

    def admit(self, command: MotionCommand, receive_ns: int, clock: OffsetEstimate | None) -> Refusal | None:
        """Refusal of a command for its session, sequence, age or range; None where it is admitted, and the
        sequence moves on. The age is not judged while `clock` is None: nothing is executed before.
        """
        window = self._window
        if window is None or command.session_id != window.session_id:
            return Refusal("session", 0.0, 0.0, "")
        if command.sequence <= window.sequence:
            rule = SECOND_WRITER if window.is_of_another_writer(command) else "sequence"
            return Refusal(rule, command.sequence, window.sequence, "")
        refusal = clock and self._check_age(receive_ns - command.stamp_ns, clock)
        refusal = refusal or self._check_range(command)
        if refusal is None:
            window.move(command)
        return refusal

    def _check_age(self, transit_ns: int, clock: OffsetEstimate) -> Refusal | None:
        """Refusal of a command from the future, or whose round trip exceeds the fastest by over `max_age_ns`;
        else None.
        """
        ahead_ns, excess_ns = clock.ahead_ns(transit_ns), clock.excess_ns(transit_ns)
        if ahead_ns > 0:
            return Refusal("future", ahead_ns * 1e-9, 0.0, "s")
        if excess_ns > self._limits.max_age_ns:
            return Refusal("late", excess_ns * 1e-9, self._limits.max_age_ns * 1e-9, "s")
        return None

    def _check_range(self, command: MotionCommand) -> Refusal | None:
        """Refusal of an implausible position or velocity, beyond the gate's limits; else None."""
        low, high = self._limits.position_m
        if not low <= command.position_m <= high:
            return Refusal("range", command.position_m, high if command.position_m > high else low, "m")
        if abs(command.velocity_m_s) > self._limits.velocity_m_s:
            return Refusal("range", command.velocity_m_s, self._limits.velocity_m_s, "m/s")
        return None
