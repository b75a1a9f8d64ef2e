"""A wall that gives way, and walls that only move: both ends at 300 ms in virtual time."""

from math import inf, pi, sin
from pathlib import Path

import pytest

from benchmarks.felt_force import CONTACT_M, TAPPING, Row
from forefeel.common.events.text import CONTACT_LOST
from forefeel.common.topics import FORCE, HAPTICS, MASTER_LIMIT
from tests.simulation.pair import Pair, S

DELAY_S = 0.3
FELT_N, ZERO_LASTS_S = 0.05, 0.1


class Wall:
    """Both ends at a wall that moves by `moves_m` each way at 1.2 Hz, and is no more from `gone_s` on."""

    def __init__(
        self,
        row: Row,
        seed: int,
        prior_dir: Path | None = None,
        gone_s: float = inf,
        moves_m: float = 0.0,
        until_s: float = 9.0,
    ) -> None:
        plan = row.plan(seed, prior_dir)
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
        zero_s = next(
            self.s(sample.stamp_ns)
            for sample in self.pair.traffic.messages(FORCE)
            if self.s(sample.stamp_ns) > self.gone_s and sample.position_m > CONTACT_M
        )
        felt_s = [
            self.s(sample.stamp_ns)
            for sample in self.pair.traffic.messages(HAPTICS)
            if abs(sample.rendered_n) > FELT_N
        ]
        return max(felt_s) - zero_s - DELAY_S / 2


@pytest.mark.parametrize(("stiffness_n_m", "gone_s"), [(300.0, 7.0), (1000.0, 8.0)])
def test_a_wall_that_gave_way_is_felt_no_longer_than_a_tenth_of_a_second(
    stiffness_n_m: float, gone_s: float
) -> None:
    wall = Wall(Row("gone", stiffness_n_m, DELAY_S), seed=4, gone_s=gone_s, until_s=gone_s + 2.5)
    assert wall.felt_s() < ZERO_LASTS_S
    assert wall.lost == 1


def test_a_prior_of_a_wall_that_gave_way_is_forgotten_too(tmp_path: Path) -> None:
    row = Row("gone", 1000.0, DELAY_S, again=True)
    first = Wall(row, 5, tmp_path, until_s=10.0).pair  # of contact there is enough for a prior
    first.master.shut_down()
    first.run(1.0)
    first.master.close(first.runtime.clock.now_ns())
    assert list(tmp_path.iterdir())
    again = Wall(row, 6, tmp_path, gone_s=5.0, until_s=7.5)
    assert again.felt_s() < ZERO_LASTS_S


@pytest.mark.parametrize(
    ("row", "moves_m"),
    [
        (Row("moves", 3000.0, DELAY_S), 0.5e-3),
        (Row("tapping", 3000.0, DELAY_S, hand=TAPPING), 0.0),
    ],
)
def test_a_wall_that_moves_or_is_tapped_is_not_forgotten(row: Row, moves_m: float) -> None:
    wall = Wall(row, seed=4, moves_m=moves_m)
    assert wall.lost == 0
