"""Our own synthetic operator: insert, dwell, withdraw, dwell; tremor; an arm that gives way to the rendered
force; seeded.
"""

from random import Random

from forefeel.common.messages import Grip
from forefeel.master.handles.motion import Arm, MinimumJerk, Tremor
from forefeel.master.handles.operator_policy import Act
from forefeel.master.handles.port import HandleReading
from forefeel.master.handles.simulated import SimulatedHandle
from forefeel.master.settings import OperatorSettings

_ALIGN_S = 0.3


class Operator(SimulatedHandle):
    """A person with a plan. The plan's time runs only while armed; after a stop the hand aligns with the
    stage and goes on from there.
    """

    def __init__(self, settings: OperatorSettings, seed: int) -> None:
        rng = Random(f"operator {seed}")
        super().__init__()
        self._settings = settings
        self._rng = rng
        self._tremor = Tremor(settings.tremor_m, rng)
        self._arm = Arm(settings.arm_mass_kg, settings.arm_damping_n_s_m, settings.arm_stiffness_n_m)
        self._force_n = 0.0
        self._reach = MinimumJerk(0.0, 0.0, _ALIGN_S)
        self._reach_s = 0.0
        self._dwell_s = 0.0
        self._stroke = 0
        self._gripper = Grip.CLOSED

    def render(self, force_n: float, now_ns: int) -> float:
        """The hand feels the force from now on."""
        del now_ns
        self._force_n = force_n
        return force_n

    def read(self, now_ns: int) -> HandleReading:
        """Moves the arm up to now."""
        dt_s = self._step_s(now_ns)
        was = self.person.act
        aligned = self._reach_s >= self._reach.duration_s
        self.person.look(now_ns * 1e-9, self._indication.state, aligned)
        self._plan(was, dt_s)
        reference_m, reference_m_s = self._reach.at(self._reach_s)
        shake_m, shake_m_s = self._tremor.at(now_ns * 1e-9)
        if dt_s > 0.0:
            self._arm.advance(reference_m + shake_m, reference_m_s + shake_m_s, self._force_n, dt_s)
        return HandleReading(self._arm.position_m, self._arm.velocity_m_s, self.person.pressed, self._gripper)

    def _plan(self, was: Act, dt_s: float) -> None:
        """What the hand aims at: the stage while it waits, the next stroke when the one before is done or was
        cut off.
        """
        act, stage_m = self.person.act, self._indication.stage_position_m
        self._reach_s += dt_s
        if act is Act.WAITING and stage_m is not None and self._reach.end_m != stage_m:
            self._begin(self._reach.at(self._reach_s)[0], stage_m, _ALIGN_S)
        elif act is Act.MOVING and (
            was is not act or self._reach_s >= self._reach.duration_s + self._dwell_s
        ):
            self._next_stroke()

    def _begin(self, start_m: float, end_m: float, duration_s: float) -> None:
        self._reach = MinimumJerk(start_m, end_m, duration_s)
        self._reach_s = 0.0

    def _next_stroke(self) -> None:
        """Alternates insertion and withdrawal; depth, pace and dwell vary by a fifth, as a person's do."""
        settings, rng = self._settings, self._rng
        inward = self._stroke % 2 == 0
        self._stroke += 1
        self._gripper = Grip.OPEN if settings.restroke and not inward else Grip.CLOSED
        depth_m = settings.depth_m * rng.uniform(0.8, 1.2)
        duration_s = (settings.insert_s if inward else settings.withdraw_s) * rng.uniform(0.8, 1.2)
        self._dwell_s = settings.dwell_s * rng.uniform(0.8, 1.2)
        here_m = self._reach.at(self._reach_s)[0]
        self._begin(here_m, settings.home_m + (depth_m if inward else 0.0), duration_s)
