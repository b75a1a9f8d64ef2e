"""The identification task and the loop that pulls what it has learned."""

from collections.abc import Iterable
from math import cos, sin
from random import Random

import numpy as np
import pytest

from forefeel.common.estimation.learner import Learner
from forefeel.common.estimation.predictor import Predictor
from forefeel.common.messages import ForceSample, Grip
from forefeel.common.settings import AxisLimits
from forefeel.master.prediction import ForcePrediction, IdentificationTask
from tests.messages import force

MS = 1_000_000
DELAY = 300
STIFFNESS_N_M, DAMPING_N_S_M, BIAS_N = 40.0, 1.5, 0.2


def position_m(n: int) -> float:
    t = n * 1e-3
    return 0.01 * (1 - cos(5 * t)) + 0.004 * sin(13 * t)


def force_n(n: int, stiffness_n_m: float = STIFFNESS_N_M) -> float:
    velocity_m_s = (position_m(n) - position_m(n - 1)) * 1e3
    return stiffness_n_m * position_m(n) + DAMPING_N_S_M * velocity_m_s + BIAS_N


def answer(n: int, measured_n: float, **changes: object) -> ForceSample:
    """The force that answers command n."""
    fields = {"position_m": position_m(n), "velocity_m_s": 0.0, "force_n": measured_n, **changes}
    return force(n + 1, (n + 77_000) * MS, (n + 1, n * MS), **fields)


class Master:
    """Loop and task; commands of 1 kHz go to a wall that executes them exactly."""

    def __init__(self) -> None:
        self.prediction = ForcePrediction(AxisLimits(workspace_m=(-0.1, 0.1)))
        self.task = IdentificationTask(self.prediction, Learner(self.prediction.evaluator))
        self.said_n = list[float | None]()

    def step(self, newest: ForceSample | None) -> None:
        """One tick with the newest force that has arrived."""
        n = len(self.said_n)
        step_s = (n * MS) * 1e-9 - ((n - 1) * MS) * 1e-9  # as the difference of two stamps is rounded
        velocity_m_s = (position_m(n) - position_m(n - 1)) / step_s if n else 0.0
        said = self.prediction.predict(n * MS, position_m(n), velocity_m_s, False, self.task.snapshot, newest)
        self.said_n.append(None if said is None else said.force_n)

    def learn(self, samples: Iterable[ForceSample]) -> None:
        for sample in samples:
            self.task.queue.put(sample)
        self.task.run()


def run(ticks: int, learning: bool, changed_at: int = 10**9) -> tuple[list[float], list[float], list[float]]:
    """(predictions, newest forces, true forces) of the ticks in which a force had arrived; from `changed_at`
    on the wall is twice as stiff."""
    master, true_n = Master(), [force_n(n, STIFFNESS_N_M * (1 + (n >= changed_at))) for n in range(ticks)]
    for n in range(ticks):
        late = answer(n - DELAY, true_n[n - DELAY]) if n >= DELAY else None
        if late is not None and learning:
            master.learn([late])
        master.step(late)
    said_n = [said for said in master.said_n if said is not None]
    return said_n, true_n[: ticks - DELAY], true_n[DELAY:]


def rms(errors: Iterable[float]) -> float:
    return float(np.sqrt(np.mean(np.square(list(errors)))))


def test_without_the_task_every_prediction_is_the_last_received_force() -> None:
    said_n, received_n, _ = run(3000, learning=False)
    assert said_n[3:] == received_n[3:]  # the third force waits for the next one to confirm it


def test_the_loop_feels_what_the_task_has_learned_and_follows_a_change_of_the_tissue() -> None:
    said_n, received_n, true_n = run(16_000, learning=True, changed_at=8000)
    error_n, zoh_n = np.subtract(said_n, true_n), np.subtract(received_n, true_n)
    assert np.count_nonzero(np.subtract(said_n, received_n)) > 15_000
    before, after = slice(3000, 7700), slice(11_000, None)
    assert rms(error_n[before]) < 0.1 * rms(zoh_n[before])
    assert rms(error_n[after]) < 0.15 * rms(zoh_n[after])


def test_the_master_predicts_what_an_evaluation_does_bit_for_bit() -> None:
    master, predictor = Master(), Predictor()
    rng = np.random.default_rng(1)
    measured_n = [force_n(n) + 0.003 * rng.standard_normal() for n in range(4000)]
    evaluated_n = list[float | None]()
    for n in range(4000):
        late = answer(n - DELAY, measured_n[n - DELAY]) if n >= DELAY else None
        master.step(late)
        if late is not None:
            master.learn([late])
        predictor.move((n * MS) * 1e-9, position_m(n))
        if late is not None:
            predictor._evaluator.hear(((n - DELAY) * MS) * 1e-9, measured_n[n - DELAY])
        said = predictor.predict()
        evaluated_n.append(None if said is None else said.force_n)
        if late is not None:
            predictor.observe(((n - DELAY) * MS) * 1e-9, measured_n[n - DELAY])
    assert master.said_n == evaluated_n
    assert master.task.snapshot.contact is not None


def test_the_contact_is_found_through_loss_and_disorder() -> None:
    master, rng = Master(), Random(5)
    waiting, newest = list[tuple[int, ForceSample]](), None
    for n in range(9000):
        master.step(newest)
        if rng.random() > 0.1:
            sample = answer(n, force_n(n), valid=rng.random() > 0.05)
            waiting.append((n + DELAY + rng.randrange(50), sample))
        if n % 5 == 0:
            rng.shuffle(waiting)
            arrived = [sample for due, sample in waiting if due <= n]
            newest = max(
                (s for s in (newest, *arrived) if s and s.valid), key=lambda s: s.stamp_ns, default=None
            )
            master.learn(arrived)
            waiting = [each for each in waiting if each[0] > n]
    contact = master.task.snapshot.contact
    assert contact is not None
    values = dict(zip(contact.names, contact.values, strict=True))
    assert values["mass_damper_spring.stiffness_n_m"] == pytest.approx(STIFFNESS_N_M, rel=0.05)
    assert values["mass_damper_spring.damping_n_s_m"] == pytest.approx(DAMPING_N_S_M, rel=0.1)
    assert master.task.unused > 300


@pytest.mark.parametrize("changes", [{"valid": False}, {"gripper": Grip.OPEN}])
def test_force_that_says_nothing_of_the_contact_is_only_counted(changes: dict[str, object]) -> None:
    master = Master()
    for n in range(1000):
        sample = answer(n, force_n(n), **changes)
        master.step(sample)
        master.learn([sample])
    assert (master.task.used, master.task.unused) == (0, 1000)
    assert set(master.said_n) == {None}
    assert not master.task.snapshot.learned.values["theta"].any()


def test_a_queue_that_overflows_drops_the_oldest_and_counts_them() -> None:
    master = Master()
    master.step(None)
    master.learn(answer(n, 1.0) for n in range(8192 + 100))
    assert (master.task.queue.dropped, master.task.used + master.task.unused) == (100, 8192)
