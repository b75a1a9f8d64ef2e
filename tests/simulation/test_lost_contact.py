"""A wall that gives way, and walls that only move: both ends at 300 ms in virtual time."""

from datetime import date
from math import inf, pi, sin
from pathlib import Path

import pytest

from benchmarks.felt_force import CONTACT_M, TAPPING, Row
from forefeel.common.estimation.contact_prior import exactly
from forefeel.common.events.text import CONTACT_LOST
from forefeel.common.prior_file import keep_prior
from forefeel.common.topics import FORCE, HAPTICS, MASTER_LIMIT
from tests.simulation.pair import Pair, S

DELAY_S = 0.3
FELT_N, ZERO_LASTS_S = 0.05, 0.1


class Wall:
    """Both ends at a wall that moves by `moves_m` each way at 1.2 Hz, and is no more from `gone_s` on."""

    def __init__(
        self,
        row: Row,
        until_s: float,
        gone_s: float = inf,
        moves_m: float = 0.0,
        prior_dir: Path | None = None,
    ) -> None:
        plan = row.plan(4, prior_dir)
        self.pair = Pair(plan.slave, plan.master)
        self.start_ns = self.pair.runtime.clock.now_ns()
        self.gone_s, self._moves_m = gone_s, moves_m
        fixture = vars(self.pair.slave.axes[0]._devices.stage)["_world"]._fixture
        self._force_n, fixture.step = fixture.step, self._step
        self.pair.to_slave.delay_s = self.pair.to_master.delay_s = DELAY_S / 2
        self.pair.run(until_s)
        self.pair.master.axes[0].flush(self.pair.runtime.clock.now_ns())

    def _step(self, t: float, x: float, v: float, a: float, dt: float) -> float:
        force_n: float = self._force_n(t, x - self._moves_m * sin(2.0 * pi * 1.2 * t), v, a, dt)
        return force_n if self.s(self.pair.runtime.clock.now_ns()) < self.gone_s else 0.0

    def s(self, stamp_ns: int) -> float:
        return (stamp_ns - self.start_ns) / S

    @property
    def lost(self) -> int:
        return sum(event.rule == CONTACT_LOST for event in self.pair.traffic.messages(MASTER_LIMIT))

    def felt_s(self) -> float:
        """Until when, after the first zero of a motion beyond the wall arrived, the hand feels it."""
        forces, haptics = self.pair.traffic.messages(FORCE), self.pair.traffic.messages(HAPTICS)
        beyond_s = [self.s(sample.stamp_ns) for sample in forces if sample.position_m > CONTACT_M]
        zero_s = next(time_s for time_s in beyond_s if time_s > self.gone_s)
        felt_s = [self.s(sample.stamp_ns) for sample in haptics if abs(sample.rendered_n) > FELT_N]
        return max(felt_s) - zero_s - DELAY_S / 2


@pytest.mark.parametrize(("stiffness_n_m", "gone_s"), [(300.0, 7.0), (1000.0, 8.0)])
def test_a_wall_that_gave_way_is_felt_no_longer_than_a_tenth_of_a_second(
    stiffness_n_m: float, gone_s: float
) -> None:
    wall = Wall(Row("gone", stiffness_n_m, DELAY_S), gone_s + 1.5, gone_s)
    assert wall.felt_s() < ZERO_LASTS_S
    assert wall.lost == 1


def test_a_prior_of_a_wall_that_gave_way_is_forgotten_too(tmp_path: Path) -> None:
    learned = {"contact_loss.contact_position_m": CONTACT_M, "mass_damper_spring.stiffness_n_m": 1000.0}
    keep_prior(tmp_path, "catheter", "simulated", exactly(learned), date(2026, 1, 1))
    wall = Wall(Row("gone", 1000.0, DELAY_S, again=True), 6.5, 5.0, prior_dir=tmp_path)
    assert wall.felt_s() < ZERO_LASTS_S
    assert wall.lost == 1


@pytest.mark.parametrize(
    ("hand", "moves_m"), [({}, 0.5e-3), (TAPPING, 0.0)], ids=["the wall moves", "the hand taps"]
)
def test_a_wall_that_moves_or_is_tapped_is_not_forgotten(hand: dict[str, float], moves_m: float) -> None:
    assert Wall(Row("stays", 3000.0, DELAY_S, hand=hand), 7.0, moves_m=moves_m).lost == 0
