"""Our own synthetic operator: insert, dwell, withdraw, dwell; tremor; an arm that gives way to the rendered
force; seeded.
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from math import cos, pi, sin
from random import Random

from forefeel.common.clock import Clock
from forefeel.common.messages import Grip, SafetyState
from forefeel.devices.simulated.settings import OperatorSettings
from forefeel.master.handle import HandleReading, Indication
from forefeel.master.passivity import late_ticks

# --- How a person uses the deadman: waits for READY, presses, moves only when ARMED, re-arms after a stop

REACTION_S = 0.5  # s from the light that allows it to the press
_PATIENCE_S = 3.0  # s that the deadman is held while the slave does not arm


class Act(Enum):
    WAITING = "hand off the deadman"
    PRESSING = "pressed, waiting for the slave to arm"
    MOVING = "armed, moving"


class SimulatedOperatorPolicy:
    """Deadman of a person, by what the display shows.

    Attributes:
        act: what the person does now.
        clutched_out_s: see the handle port.
    """

    def __init__(self) -> None:
        self.act = Act.WAITING
        self.clutched_out_s = 0.0
        self._since_s = 0.0
        self._chosen = False
        self._previous_s: float | None = None

    @property
    def pressed(self) -> bool:
        return self.act is not Act.WAITING

    def look(self, now_s: float, state: SafetyState | None, aligned: bool = True) -> None:
        """Presses or releases the deadman by the state that is shown: changes `act`. Presses when READY,
        after waiting for at least 0.5 s, if the hand is at the stage (`aligned`); moves when ARMED; releases
        if that takes more than 3 s, or it is no longer ARMED. After `release` it adds to `clutched_out_s`
        until ARMED.
        """
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
                self._enter(Act.WAITING, now_s)

    def release(self, now_s: float) -> None:
        self._chosen = True
        self._enter(Act.WAITING, now_s)

    def _enter(self, act: Act, now_s: float) -> None:
        self.act, self._since_s = act, now_s


# --- Base of the simulated handles: a person, what the person sees, the time between two reads.
_MAX_STEP_S = 0.05  # s that the person moves at most between two reads


class SimulatedHandle:
    """A handle without hardware, which does not fail.

    Attributes:
        person: who holds the deadman.
        finished: whether a motion that ends by itself has ended.
    """

    actuator_delay_s = 0.0

    def __init__(self) -> None:
        self.person = SimulatedOperatorPolicy()
        self.finished = False
        self._indication = Indication(None, None)
        self._previous_ns: int | None = None

    @property
    def clutched_out_s(self) -> float:
        """Time that the person chose to spend with the clutch open."""
        return self.person.clutched_out_s

    def open(self) -> None: ...

    def close(self) -> None: ...

    def rearm(self) -> None: ...

    @property
    def pressed_anew(self) -> bool:
        """Always false: it is asked after a fault only, and this handle has none."""
        return False

    @property
    def counters(self) -> Mapping[str, int]:
        return {}

    def show(self, indication: Indication) -> None:
        self._indication = indication

    def _step_s(self, now_ns: int) -> float:
        """Time in s since the last read; a stall of the host moves nobody for longer than 50 ms."""
        previous_ns, self._previous_ns = self._previous_ns, now_ns
        return 0.0 if previous_ns is None else min((now_ns - previous_ns) * 1e-9, _MAX_STEP_S)


# --- Minimum-jerk reaches and physiological tremor (Flash and Hogan 1985; Riviere et al. 1998: 6-12 Hz).
@dataclass(frozen=True, slots=True)
class MinimumJerk:
    """A reach from rest to rest: x = x0 + (x1 - x0)(10 s^3 - 15 s^4 + 6 s^5), s = t / T."""

    start_m: float
    end_m: float
    duration_s: float

    def at(self, t_s: float) -> tuple[float, float]:
        """(position m, velocity m/s) at time t since the start; at rest before and after."""
        s = min(max(t_s / self.duration_s, 0.0), 1.0)
        length_m = self.end_m - self.start_m
        position_m = self.start_m + length_m * s**3 * (10.0 + s * (6.0 * s - 15.0))
        return position_m, length_m / self.duration_s * 30.0 * s * s * (1.0 - s) ** 2


class Tremor:
    """Three sines between 6 and 12 Hz with seeded frequencies and phases; `amplitude_m` is the sum of their
    amplitudes.
    """

    def __init__(self, amplitude_m: float, rng: Random) -> None:
        self._sines = [
            (amplitude_m / 3.0, 2.0 * pi * rng.uniform(6.0, 12.0), rng.uniform(0.0, 2.0 * pi))
            for _ in range(3)
        ]

    def at(self, t_s: float) -> tuple[float, float]:
        """(displacement m, velocity m/s) at time t."""
        position_m = velocity_m_s = 0.0
        for amplitude_m, omega, phase in self._sines:
            position_m += amplitude_m * sin(omega * t_s + phase)
            velocity_m_s += amplitude_m * omega * cos(omega * t_s + phase)
        return position_m, velocity_m_s


class Arm:
    """A hand and forearm at a reference point: M x'' = K (x_ref - x) + B (v_ref - v) - f, which the rendered
    force f really moves.

    Integrated by the semi-implicit Euler method in steps of at most 0.5 ms (the poles lie near 30 rad/s).
    """

    def __init__(self, mass_kg: float, damping_n_s_m: float, stiffness_n_m: float) -> None:
        self._m, self._b, self._k = mass_kg, damping_n_s_m, stiffness_n_m
        self.position_m = 0.0
        self.velocity_m_s = 0.0

    def place(self, position_m: float) -> None:
        self.position_m, self.velocity_m_s = position_m, 0.0

    def advance(self, reference_m: float, reference_m_s: float, force_n: float, dt_s: float) -> None:
        """Integrates position and velocity over `dt_s`, with a reference (m, m/s) and a resisting force."""
        steps = max(1, int(dt_s / 0.5e-3 + 0.999))
        h = dt_s / steps
        for _ in range(steps):
            spring = self._k * (reference_m - self.position_m) + self._b * (reference_m_s - self.velocity_m_s)
            self.velocity_m_s += h * (spring - force_n) / self._m
            self.position_m += h * self.velocity_m_s


# --- The operator: inserts, dwells, withdraws, dwells; tremor; an arm that gives way to the rendered force

_ALIGN_S = 0.3  # s in which the hand comes to where the stage is


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
        ticks = late_ticks(settings.actuator_delay_s) + 1
        self._forces_n = deque([0.0] * ticks, maxlen=ticks)
        self._reach = MinimumJerk(0.0, 0.0, _ALIGN_S)
        self._reach_s = 0.0
        self._dwell_s = 0.0
        self._stroke = 0
        self._gripper = Grip.CLOSED

    def render(self, force_n: float, now_ns: int) -> float:
        del now_ns
        self._forces_n.append(force_n)
        return force_n

    def read(self, now_ns: int) -> HandleReading:
        """Advances the person to `now_ns` (deadman, plan, arm) and returns position and velocity of the arm.
        The arm feels the rendered force, late by the actuator's delay; a repeated call at one time moves
        nothing.
        """
        dt_s = self._step_s(now_ns)
        was = self.person.act
        aligned = self._reach_s >= self._reach.duration_s
        self.person.look(now_ns * 1e-9, self._indication.state, aligned)
        self._plan(was, dt_s)
        reference_m, reference_m_s = self._reach.at(self._reach_s)
        shake_m, shake_m_s = self._tremor.at(now_ns * 1e-9)
        if dt_s > 0.0:
            self._arm.advance(reference_m + shake_m, reference_m_s + shake_m_s, self._forces_n[0], dt_s)
        return HandleReading(self._arm.position_m, self._arm.velocity_m_s, self.person.pressed, self._gripper)

    def _plan(self, was: Act, dt_s: float) -> None:
        """Moves the reach on by `dt_s`. Begins a new one to the stage while the person waits, if the stage is
        elsewhere, and the next stroke while moving: at once when moving begins (`was`: the act before), then
        when the last one and its dwell are over.
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
        """Begins the next stroke, insertion and withdrawal in turn; an insertion closes the gripper. Depth,
        duration and dwell vary by up to a fifth. With `restroke` a withdrawal opens the gripper.
        """
        settings, rng = self._settings, self._rng
        inward = self._stroke % 2 == 0
        self._stroke += 1
        self._gripper = Grip.OPEN if settings.restroke and not inward else Grip.CLOSED
        depth_m = settings.depth_m * rng.uniform(0.8, 1.2)
        duration_s = (settings.insert_s if inward else settings.withdraw_s) * rng.uniform(0.8, 1.2)
        self._dwell_s = settings.dwell_s * rng.uniform(0.8, 1.2)
        here_m = self._reach.at(self._reach_s)[0]
        self._begin(here_m, settings.home_m + (depth_m if inward else 0.0), duration_s)


def make_operator(settings: OperatorSettings, _clock: Clock) -> Operator:
    return Operator(settings, settings.seed)
