"""Whether a motor that is wired the other way is noticed, with simulated hands at walls of springs."""

import numpy as np
import pytest

from forefeel.common.events.console import Notices
from forefeel.common.messages import SafetyState
from forefeel.devices.simulated.operator import Operator
from forefeel.devices.simulated.settings import OperatorSettings
from forefeel.master.handle import HandleReading, HandleWatch, Indication
from forefeel.master.polarity import PolarityCheck
from forefeel.master.rendering import ForceRenderer
from forefeel.master.settings import RenderingSettings

MS = 1_000_000
WALL_M = 0.008
HANDS: dict[str, dict[str, float]] = {
    "relaxed": {},
    "loose": {"arm_mass_kg": 0.1, "arm_damping_n_s_m": 1.5, "arm_stiffness_n_m": 40.0},
    "tapping": {"insert_s": 0.22, "withdraw_s": 0.22, "dwell_s": 0.02, "depth_m": 0.012},
    "shaking": {"tremor_m": 0.0012},
    "stiff": {"arm_mass_kg": 0.6, "arm_damping_n_s_m": 40.0, "arm_stiffness_n_m": 1000.0, "depth_m": 0.006},
    "pushing hard": {"arm_mass_kg": 0.6, "arm_damping_n_s_m": 20.0, "arm_stiffness_n_m": 3000.0},
}


class ReversedMotor(Operator):
    def render(self, force_n: float, now_ns: int) -> float:
        return -super().render(-force_n, now_ns)


class Played(ReversedMotor):
    def read(self, now_ns: int) -> HandleReading:
        return super().read(now_ns)._replace(recording_time_s=now_ns * 1e-9)


def _strokes(kind: type[Operator], hand: str, wall_n_m: float) -> tuple[HandleWatch, HandleReading, float]:
    """The handle's watch, its last reading and force, after 12 s of strokes."""
    operator = kind(OperatorSettings.model_validate({"depth_m": 0.015} | HANDS[hand]), seed=2)
    watch = HandleWatch(operator, Notices(), lambda: None)
    renderer, state = ForceRenderer(RenderingSettings()), SafetyState.READY
    reading, applied_n = HandleReading(0.0, 0.0, False), 0.0
    for now_ns in range(0, 12_000 * MS, MS):
        operator.show(Indication(state, 0.005))
        reading = watch.read(now_ns)
        state = SafetyState.ARMED if reading.deadman else SafetyState.READY
        wall_n = max(0.0, wall_n_m * (reading.position_m - WALL_M))
        applied_n = watch.render(
            renderer.render(now_ns, wall_n, reading.deadman, reading.position_m).force_n, now_ns
        )
        renderer.applied(applied_n)
    return watch, reading, applied_n


RESISTING = [(Operator, hand, wall_n_m) for hand in HANDS for wall_n_m in (300.0, 3000.0)]


@pytest.mark.parametrize(("kind", "hand", "wall_n_m"), [*RESISTING, (Played, "relaxed", 3000.0)])
def test_resisting_motor_or_played_motion_is_sound(kind: type[Operator], hand: str, wall_n_m: float) -> None:
    watch, reading, _ = _strokes(kind, hand, wall_n_m)
    assert watch.fault is None
    assert reading.deadman


@pytest.mark.parametrize("hand", ["relaxed", "loose", "tapping", "shaking"])
def test_a_reversed_motor_is_a_fault_that_stays(hand: str) -> None:
    watch, reading, applied_n = _strokes(ReversedMotor, hand, 3000.0)
    assert watch.fault is not None
    assert (reading.deadman, applied_n) == (False, 0.0)


def test_a_force_that_only_ramps_tells_nothing_of_the_motor() -> None:
    """A force as smooth as that of a hand, and tremor whose motion it can not have made."""
    time_s = np.arange(4000) * 1e-3
    force_n = np.sin(2.0 * np.pi * 0.5 * time_s)  # up to 0.3 N in a window
    for seed in range(50):
        random = np.random.default_rng(seed)
        rates_hz, phases = random.uniform(8.0, 12.0, 5), random.uniform(0.0, 2.0 * np.pi, 5)
        moved_m = 2e-5 * np.sin(2.0 * np.pi * time_s[:, None] * rates_hz + phases).sum(axis=1)
        check = PolarityCheck()
        assert not any(map(check.is_reversed, moved_m.tolist(), force_n.tolist()))
