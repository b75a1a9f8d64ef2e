"""The live prediction on a drive that lags and a contact that imports nothing of the predictor."""

from math import cos, pi, sin

import numpy as np
import pytest

from forefeel.common.causes.model import SCHEMA, ContactModel
from forefeel.common.estimation.evaluator import Estimate
from forefeel.common.estimation.learner import Learner
from forefeel.common.limiter import MotionLimiter, Reaction
from forefeel.common.messages import ForceSample
from forefeel.common.settings import AxisLimits
from forefeel.master.prediction import ExpectedSetpoint, ForcePrediction, IdentificationTask
from tests.messages import force
from tests.unit.test_stage_lag import Drive, _reach

MS = 1_000_000
MS_S = 1e-3
DELAY = 300
LIMITS = AxisLimits(workspace_m=(-0.1, 0.2), max_velocity_m_s=1.0, max_acceleration_m_s2=50.0)
SPRING = ContactModel.from_mapping(
    {"schema": SCHEMA, "name": "m, b, k", "effects": [{"effect": "mass_damper_spring"}]}
)
STIFFNESS, DAMPING = 60.0, 1.0


class Bench:
    """Commands of a stroke, a drive of 5 Hz without feed-forward, a spring and a damper, noise of 2 mN."""

    def __init__(self) -> None:
        self._drive = Drive(2 * pi * 5.0, feed_forward=False)
        self._noise = np.random.default_rng(3)
        self.samples = list[ForceSample]()
        self.commands = list[tuple[int, float, float]]()

    def step(self) -> tuple[int, float, float]:
        """The next command; the slave executes it and measures."""
        n = len(self.samples)
        command_m, before_m = _reach(n * 1e-3), self._drive.x
        position_m = self._drive.step(command_m)
        velocity_m_s = (position_m - before_m) * 1e3
        force_n = STIFFNESS * position_m + DAMPING * velocity_m_s + 0.002 * self._noise.standard_normal()
        moved = {"position_m": position_m, "velocity_m_s": velocity_m_s, "force_n": force_n}
        self.samples.append(force(n + 1, (n + 77_000) * MS, (n + 1, (n + 5) * MS), **moved))
        self.commands.append(((n + 5) * MS, command_m, (command_m - _reach((n - 1) * 1e-3)) * 1e3))
        return self.commands[-1]

    @property
    def arrived(self) -> ForceSample | None:
        """The force that arrives in this tick."""
        return self.samples[-1 - DELAY] if len(self.samples) > DELAY else None


def _rms(errors: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(errors))))


@pytest.mark.parametrize("model", [None, SPRING])
def test_the_predictor_learns_the_lag_with_the_contact(model: ContactModel | None) -> None:
    bench, prediction = Bench(), ForcePrediction(LIMITS)
    task = IdentificationTask(prediction, Learner(prediction.evaluator, model=model))
    predicted, held = list[float](), list[float]()
    for n in range(10_000):
        stamp_ns, command_m, velocity_m_s = bench.step()
        late = bench.arrived
        said = prediction.predict(stamp_ns, command_m, velocity_m_s, True, task.snapshot, late)
        if late is not None:
            task.queue.put(late)
            task.run()
        if n > 5000 and said is not None and late is not None:
            predicted.append(said.force_n - bench.samples[-1].force_n)
            held.append(late.force_n - bench.samples[-1].force_n)
    assert len(predicted) > 4000
    assert _rms(predicted) < 0.08 * _rms(held)


def test_the_setpoint_is_what_the_shared_limits_leave_of_the_command() -> None:
    """A jump of 50 mm under 0.1 m/s and 5 m/s^2, and back to the stage without the deadman."""
    limits = AxisLimits(max_velocity_m_s=0.1, max_acceleration_m_s2=5.0, stiffest_wall_n_m=1.0)
    setpoint = ExpectedSetpoint(limits)
    setpoint.follow(0, 0.0, 0.0, deadman=False)
    positions_m = [setpoint.follow(n * MS, 0.05, 0.0, deadman=True) for n in range(1, 700)]
    speeds_m_s = np.diff(positions_m) / 1e-3
    assert speeds_m_s.max() == pytest.approx(0.1, rel=1e-6)
    assert np.abs(np.diff(speeds_m_s)).max() <= 5.0e-3 * (1 + 1e-6)
    assert positions_m[-1] == pytest.approx(0.05, abs=1e-9)
    assert setpoint.follow(701 * MS, 0.01, 0.0, deadman=False) == 0.01


def test_a_new_grip_expects_the_setpoint_at_the_hand_and_not_where_the_last_one_was() -> None:
    prediction = ForcePrediction(LIMITS)
    snapshot = IdentificationTask(prediction, Learner(prediction.evaluator)).snapshot
    prediction.predict(0, 0.05, 0.0, True, snapshot, None)
    prediction.reset()
    prediction.predict(200 * MS, 0.005, 0.0, True, snapshot, None)
    assert prediction.stage_m == 0.005


def test_a_reaction_that_no_slave_can_have_takes_bounded_memory() -> None:
    setpoint = ExpectedSetpoint(LIMITS)
    setpoint.react(Reaction(1e6, 1e6, 1e6, 1e6))
    for n in range(3000):
        setpoint.follow(n * MS, 0.01, 0.0, deadman=True)
    assert max(len(setpoint._expected_n), len(setpoint._limiter._shown)) < 1010


def test_what_the_slaves_force_limit_left_corrects_the_setpoint_expected() -> None:
    """A hand goes 10 mm into a wall that begins at 2 mm and bears 1 N/mm, and back. The master knows the wall
    1.5 s later than the slave, whose limit leaves 3 mm of it.
    """
    limits = AxisLimits(max_force_n=3.0, stiffest_wall_n_m=1000.0)
    slave, expected, samples = MotionLimiter(limits, 5.0), ExpectedSetpoint(limits), list[ForceSample]()
    errors_m, setpoint_m = list[float](), expected.follow(0, 0.0, 0.0, deadman=False)
    for n in range(1, 4000):
        asked_m, velocity_m_s = 5e-3 * (1 - cos(pi / 2 * n * MS_S)), 2.5e-3 * pi * sin(pi / 2 * n * MS_S)
        slave.follow(asked_m, velocity_m_s, 1000.0 * max(0.0, slave.position_m - 2e-3), MS_S)
        left = {"setpoint_m": slave.position_m, "force_limited": slave.force_limited}
        samples.append(force(n, n * MS, (n, n * MS), **left))
        if n > DELAY:
            expected.correct(samples[n - 1 - DELAY], asked_m)
        known_n = 1000.0 * max(0.0, setpoint_m - 2e-3) if n > 1500 else 0.0
        belief = Estimate(known_n, known_n, known_n)
        setpoint_m = expected.follow(n * MS, asked_m, velocity_m_s, deadman=True, expected=belief)
        errors_m.append(slave.position_m - setpoint_m)
        if slave.force_limited:
            assert expected.error_m(samples[-1]) == errors_m[-1]
    limited = [sample.force_limited for sample in samples]
    assert (all(limited[1200:2500]), any(limited[3000:])) == (True, False)
    assert errors_m[1400] < -2e-3
    assert np.abs(errors_m[1500 + 2 * DELAY :]).max() < 5e-5
    lie = samples[2000].model_copy(update={"setpoint_m": 10.0, "answers_stamp_ns": 3999 * MS})
    assert lie.force_limited
    expected.correct(lie, 0.0)
    assert expected.follow(4000 * MS, 0.0, 0.0, deadman=True) <= limits.workspace_m[1]
