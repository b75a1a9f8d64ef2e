"""The slave's safety state machine: one table, (state, event) -> state. Pure.

```
IDLE --session_opened--> READY --engage--> ENGAGING --engaged--> ARMED
                           ^                  |                    |
                           |     release, watchdog, session_lost, misaligned, round_trip, shutdown
                           |                  v                    v
                           +---- at_rest --- STOPPING <------------+
any --estop--> ESTOPPED --clear--> IDLE          any but ESTOPPED --fault--> FAULT --clear--> IDLE
```
Only ENGAGING and ARMED follow commands; every other state ramps to zero velocity and holds.
"""

from enum import StrEnum

from forefeel.common.messages import FOLLOWING, SafetyState


class SafetyEventName(StrEnum):
    SESSION_OPENED = "session_opened"
    SESSION_LOST = "session_lost"
    ENGAGE = "engage"
    ENGAGED = "engaged"
    RELEASE = "release"
    WATCHDOG = "watchdog"
    MISALIGNED = "misaligned"
    ROUND_TRIP = "round_trip"
    AT_REST = "at_rest"
    SHUTDOWN = "shutdown"
    FAULT = "fault"
    ESTOP = "estop"
    CLEAR = "clear"


S, E = SafetyState, SafetyEventName
_STOPS = (E.RELEASE, E.WATCHDOG, E.SESSION_LOST, E.MISALIGNED, E.ROUND_TRIP, E.SHUTDOWN)

TABLE: dict[tuple[SafetyState, SafetyEventName], SafetyState] = {
    (S.IDLE, E.SESSION_OPENED): S.READY,
    (S.READY, E.SESSION_LOST): S.IDLE,
    (S.READY, E.ENGAGE): S.ENGAGING,
    (S.ENGAGING, E.ENGAGED): S.ARMED,
    **{(state, event): S.STOPPING for state in (S.ENGAGING, S.ARMED) for event in _STOPS},
    (S.STOPPING, E.AT_REST): S.READY,
    **{(state, E.FAULT): S.FAULT for state in S if state is not S.ESTOPPED},
    **{(state, E.ESTOP): S.ESTOPPED for state in S},
    (S.FAULT, E.CLEAR): S.IDLE,
    (S.ESTOPPED, E.CLEAR): S.IDLE,
}
"""Every transition there is; a pair that is not listed leaves the state as it is."""


class SafetyMachine:
    """Holds the state; `fire` is the only way to change it."""

    def __init__(self) -> None:
        self.state = S.IDLE
        self.reason = "started"

    @property
    def following(self) -> bool:
        return self.state in FOLLOWING

    def fire(self, event: SafetyEventName, reason: str) -> tuple[SafetyState, SafetyState] | None:
        """Changes the state by the table, and takes the reason; returns (before, after), or None where both
        stay as they are.
        """
        before = self.state
        after = TABLE.get((before, event), before)
        if after is before:
            return None
        self.state, self.reason = after, reason
        return before, after
