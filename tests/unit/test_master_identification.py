from itertools import pairwise
from math import cos, sin
from random import Random

import pytest

from forefeel.common.causes.model import ContactModel
from forefeel.common.estimation.identification import (
    ContactEstimate,
    ContactIdentifier,
    IdentificationSettings,
)
from forefeel.common.messages import ForceSample
from forefeel.master.identification import IdentificationTask
from tests.unit.dashboard.said import force

TICK = 4_000_000  # the contact model's parameters are identified from 250 samples a second
WALL = {"mass_kg": 0.0, "damping_n_s_m": 0.0, "stiffness_n_m": 0.0}
EFFECTS = [{"effect": "mass_damper_spring", "parameters": WALL}]
MODEL = ContactModel.from_mapping({"schema": "forefeel.model/1", "name": "wall", "effects": EFFECTS})
STIFFNESS, DAMPING = 40.0, 1.5


class Notes(ContactIdentifier):
    """A true identifier whose input can be looked at."""

    def __init__(self) -> None:
        super().__init__(MODEL, IdentificationSettings(min_updates=200))
        self.seen = list[int]()

    def observe(self, stamp_ns: int, position_m: float, force_n: float) -> None:
        self.seen.append(stamp_ns)
        super().observe(stamp_ns, position_m, force_n)


def sample(stamp_ns: int, session_id: int = 1, valid: bool = True, answers: int | None = 1) -> ForceSample:
    t = stamp_ns * 1e-9
    x, v = 0.01 * (1 - cos(5 * t)) + 0.004 * sin(13 * t), 0.05 * sin(5 * t) + 0.052 * cos(13 * t)
    force_n = STIFFNESS * x + DAMPING * v if valid else 99.0
    answered = None if answers is None else (answers, 0)
    moved = {"position_m": x, "velocity_m_s": v, "force_n": force_n}
    return force(1, stamp_ns, answered, session_id=session_id, valid=valid, **moved)


class NothingElse:
    """Learns nothing."""

    def learn(self, sample: ForceSample) -> float:
        return sample.force_n

    def publish(self) -> None: ...


def task() -> tuple[IdentificationTask, Notes]:
    notes = Notes()
    return IdentificationTask(notes, NothingElse()), notes


def known(identification: IdentificationTask) -> ContactEstimate:
    identification.update_estimate()
    assert identification.estimate is not None
    return identification.estimate


def test_each_batch_is_learned_in_the_order_of_the_stamps() -> None:
    identification, notes = task()
    for stamps in ([3, 1, 2], [6, 4, 5]):
        for stamp in stamps:
            identification.queue.put(sample(stamp * TICK))
        identification.run()
    assert notes.seen == [i * TICK for i in range(1, 7)]
    assert (notes.samples, notes.ignored) == (6, 0)


def test_invalid_forces_and_those_that_answer_no_command_are_not_learned_from_but_counted() -> None:
    identification, notes = task()
    for stamp, valid, answers in (
        (1, True, 1),
        (2, False, 1),
        (3, True, None),
        (4, False, None),
        (5, True, 2),
    ):
        identification.queue.put(sample(stamp * TICK, valid=valid, answers=answers))
    identification.run()
    assert notes.seen == [1 * TICK, 5 * TICK]
    assert identification.unused == 3


def test_the_contact_is_found_through_loss_jitter_and_invalid_samples() -> None:
    identification, _ = task()
    rng = Random(5)
    stamps = [i * TICK for i in range(6000) if rng.random() > 0.1]
    arrivals = sorted(stamps, key=lambda stamp: stamp + rng.randrange(4) * TICK)
    for start in range(0, len(arrivals), 20):
        for stamp in arrivals[start : start + 20]:
            identification.queue.put(sample(stamp, valid=rng.random() > 0.05))
        identification.run()
    estimate = known(identification)
    assert estimate.valid
    values = dict(zip(estimate.names, estimate.values, strict=True))
    assert values["mass_damper_spring.stiffness_n_m"] == pytest.approx(STIFFNESS, rel=0.03)
    assert values["mass_damper_spring.damping_n_s_m"] == pytest.approx(DAMPING, rel=0.05)
    assert identification.unused > 100


def test_a_queue_that_overflows_drops_the_oldest_and_counts_them() -> None:
    identification, notes = task()
    for stamp in range(1, 8192 + 101):
        identification.queue.put(sample(stamp * TICK, answers=None if stamp <= 100 else 1))
    identification.run()
    assert (identification.queue.dropped, identification.unused, notes.seen[0]) == (100, 0, 101 * TICK)


def test_a_slave_whose_host_was_started_again_is_learned_from_after_a_pause() -> None:
    identification, notes = task()
    for stamp, session_id in ((70_001, 1), (70_000, 1), (5, 2), (4, 2)):
        identification.queue.put(sample(stamp * TICK, session_id))
    identification.run()
    identification.queue.put(sample(7 * TICK, 2))
    identification.queue.put(sample(6 * TICK, 2))
    identification.run()
    identification.queue.put(sample(2 * TICK, 3))
    identification.run()
    assert notes.ignored == 0
    assert notes.seen[:2] == [70_000 * TICK, 70_001 * TICK]
    steps = [(after - before) // TICK for before, after in pairwise(notes.seen)]
    assert steps == [1, 250, 1, 1, 1, 250]
