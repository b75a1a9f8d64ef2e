"""The control loop of one axis with everything that a test decides: time, stage, force, session, commands."""

from dataclasses import dataclass, field
from typing import Any

from forefeel.common.clock_offset import OffsetEstimate
from forefeel.common.limiter import PROMPT
from forefeel.common.messages import Grip, MotionCommand, SafetyState
from forefeel.common.settings import AxisLimits
from forefeel.slave.control import AxisControl, ControlInputs, ControlOutputs
from forefeel.slave.settings import GateSettings
from tests.clocks import compared

MS = 1_000_000
START_M = 0.02
SESSION = 5
LIMITS = AxisLimits(workspace_m=(-0.01, 0.1), stiffest_wall_n_m=1.0)  # no contact slows it
GATE = GateSettings()
COMPARED = compared(0, 5 * MS)


@dataclass
class Rig:
    """One tick per call of `tick`; a perfect stage follows the setpoint unless `stage_m` is set."""

    gate: GateSettings = GATE
    now_ns: int = 1000 * MS
    stage_m: float = START_M
    follows: bool = True
    force_n: float = 0.0
    force_valid: bool = True
    force_age_s: float = 0.0
    session_live: bool = True
    session_id: int = SESSION
    clock: OffsetEstimate | None = COMPARED
    sequence: int = 0
    events: list[str] = field(default_factory=list)
    rules: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.control = AxisControl(LIMITS, self.gate, PROMPT, self.stage_m)
        self.out = ControlOutputs(self.stage_m, 0.0, False, Grip.CLOSED, None)

    def state(self) -> SafetyState:
        return self.control.machine.state

    @property
    def reason(self) -> str:
        return self.control.machine.reason

    def command(self, position_m: float, deadman: bool, **changes: Any) -> tuple[MotionCommand, int]:  # noqa: ANN401
        self.sequence += 1
        fields: dict[str, Any] = {"session_id": self.session_id, "velocity_m_s": 0.0, **changes}
        command = MotionCommand(
            sequence=self.sequence, stamp_ns=self.now_ns, position_m=position_m, deadman=deadman, **fields
        )
        return command, self.now_ns

    def tick(self, command: tuple[MotionCommand, int] | None = None, **changes: Any) -> ControlOutputs:  # noqa: ANN401
        inputs = ControlInputs(
            command=command,
            position_m=self.stage_m,
            force_n=self.force_n,
            force_valid=self.force_valid,
            force_age_s=self.force_age_s,
            session_live=self.session_live,
            clock=self.clock,
        )
        self.out = self.control.tick(self.now_ns, inputs._replace(**changes))
        self.events += [event.value for _, event, _, _ in self.out.transitions]
        self.rules += [hit.rule for hit in self.out.limits]
        if self.follows and self.out.moving:
            self.stage_m = self.out.target_m
        self.now_ns += MS
        return self.out

    def released(self, ticks: int = 1) -> None:
        for _ in range(ticks):
            self.tick(self.command(self.stage_m, False))

    def held(self, ticks: int = 1, position_m: float | None = None, **changes: Any) -> None:  # noqa: ANN401
        """Deadman pressed, on the spot or at a position."""
        for _ in range(ticks):
            self.tick(self.command(self.stage_m if position_m is None else position_m, True, **changes))

    def engaged(self) -> "Rig":
        """Ready, released, pressed: ENGAGING."""
        self.released(3)
        self.held()
        assert self.state() is SafetyState.ENGAGING, self.reason
        return self

    def armed(self) -> "Rig":
        """Through the ramp: ARMED at rest."""
        self.engaged()
        self.held(round(self.gate.engage_ramp_s * 1000) + 1)
        assert self.state() is SafetyState.ARMED, self.reason
        self.events.clear()
        self.rules.clear()
        return self

    def moving(self, velocity_m_s: float = 0.1) -> "Rig":
        self.armed()
        position_m = self.stage_m
        for _ in range(100):
            position_m += velocity_m_s * 1e-3
            self.held(1, position_m, velocity_m_s=velocity_m_s)
        assert abs(self.out.velocity_m_s - velocity_m_s) < 0.01
        return self

    def at_rest_m(self, most_ticks: int = 200) -> float:
        """Ticks without input until nothing moves; where that is."""
        for _ in range(most_ticks):
            if not self.out.moving:
                break
            self.tick()
        assert not self.out.moving
        return self.stage_m
