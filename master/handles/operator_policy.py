"""How a person uses the deadman: waits for READY, presses, moves only when ARMED, lets go at a stop, re-arms
half a second later.
"""

from enum import Enum

from forefeel.common.messages import SafetyState

REACTION_S = 0.5
_PATIENCE_S = 3.0


class Act(Enum):
    """What the person is doing."""

    WAITING = "hand off the deadman"
    PRESSING = "pressed, waiting for the slave to arm"
    MOVING = "armed, moving"


class SimulatedOperatorPolicy:
    """Decides from what is shown.

    Attributes:
        act: what the person does now.
        stops: stops that the person did not choose.
        clutched_out_s: see the handle port.
    """

    def __init__(self) -> None:
        self.act = Act.WAITING
        self.stops = 0
        self.clutched_out_s = 0.0
        self._since_s = 0.0
        self._chosen = False
        self._previous_s: float | None = None

    @property
    def pressed(self) -> bool:
        """Whether the deadman is held."""
        return self.act is not Act.WAITING

    def look(self, now_s: float, state: SafetyState | None, aligned: bool = True) -> None:
        """One glance at the display; nobody presses before the hand is `aligned` with the stage."""
        elapsed_s = now_s - (self._previous_s if self._previous_s is not None else now_s)
        self._previous_s = now_s
        if self._chosen:
            self.clutched_out_s += elapsed_s
        match self.act:
            case Act.WAITING if state is SafetyState.READY and now_s - self._since_s >= REACTION_S:
                if aligned:
                    self._enter(Act.PRESSING, now_s)
            case Act.PRESSING if state is SafetyState.ARMED:
                self._chosen = False
                self._enter(Act.MOVING, now_s)
            case Act.PRESSING if now_s - self._since_s > _PATIENCE_S:
                self._enter(Act.WAITING, now_s)
            case Act.MOVING if state is not SafetyState.ARMED:
                self.stops += 1
                self._enter(Act.WAITING, now_s)

    def release(self, now_s: float) -> None:
        """Opens the clutch by choice."""
        self._chosen = True
        self._enter(Act.WAITING, now_s)

    def _enter(self, act: Act, now_s: float) -> None:
        self.act, self._since_s = act, now_s
