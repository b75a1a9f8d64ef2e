"""The reference servo: healthy stages are believed, others are not; rest is measured."""

from collections.abc import Callable
from math import cos, e, pi

import pytest

from forefeel.common.estimation.stage_lag import StageLag
from forefeel.common.limiter import MotionLimiter
from forefeel.common.settings import AxisLimits
from forefeel.slave.following import DEVIATION_M, FollowingWatch, KnownServo, LateStage
from forefeel.slave.plant.settings import preset
from forefeel.slave.plant.stage import PlantStage
from forefeel.slave.stage import StageReading

MS = 1_000_000
HZ, LIMIT_M_S2, LAG_S = 25.0, 20.0, 0.1
Expected = Callable[[], KnownServo | LateStage]
EXPECTED: list[Expected] = [lambda: KnownServo(HZ, LIMIT_M_S2), lambda: LateStage(LAG_S)]
Liar = Callable[[int, float, float], float]
"""(ms, where it would be, where it was before) -> where it is, in m."""


def reach_m(t: float) -> float:
    return 0.03 * (1.0 - cos(2 * pi * 0.5 * t))


def steps_m(t: float) -> float:
    return 0.05 if t % 0.8 < 0.4 else 0.02


class Bench:
    """The limiter leads the simulated servo of 25 Hz, whose position a liar may change."""

    def __init__(
        self,
        watch: FollowingWatch,
        asked_m: Callable[[float], float],
        liar: Liar | None = None,
        hz: float = HZ,
    ) -> None:
        self.watch, self._asked_m, self._liar = watch, asked_m, liar
        self.limiter = MotionLimiter(AxisLimits(), 4.0)
        settings = preset("catheter").stage.model_copy(update={"bandwidth_hz": hz})
        self._stage = PlantStage(settings, 1e-4)
        self.ms, self.x_m = 0, 0.0
        self.worst_m = self.expected_m = 0.0
        self._servo = KnownServo(HZ, LIMIT_M_S2)
        self.limiter.place(0.0)

    def tick(self) -> str | None:
        """One ms; the fault of its end."""
        now_ns, asked_m = self.ms * MS, self._asked_m(self.ms * 1e-3)
        velocity_m_s = (self._asked_m(self.ms * 1e-3 + 1e-4) - asked_m) * 1e4
        self.limiter.follow(asked_m, velocity_m_s, 0.0, 1e-3)
        setpoint = self.limiter.position_m, self.limiter.velocity_m_s
        self._stage.command(*setpoint, self.ms * 1e-3)
        self.watch.command(*setpoint, now_ns)
        self._servo.command(*setpoint, now_ns)
        for step in range(1, 11):
            self._stage.step(self.ms * 1e-3 + step * 1e-4)
        self.ms += 1
        x_m = self._stage.position_m
        self.x_m = x_m if self._liar is None else self._liar(self.ms, x_m, self.x_m)
        self.expected_m, _ = self._servo.span_m(self.ms * MS)
        why = self.watch.read(StageReading(self.x_m, 0.0), self.ms * MS)
        self.worst_m = max(self.worst_m, self.watch.deviation_m)
        return why


@pytest.mark.parametrize("asked_m", [reach_m, steps_m])
@pytest.mark.parametrize("expected", EXPECTED, ids=["servo", "late"])
def test_healthy_stage_is_no_fault(expected: Expected, asked_m: Callable[[float], float]) -> None:
    """At up to 0.2 m/s and 8 m/s^2."""
    bench = Bench(FollowingWatch(expected()), asked_m)
    assert not any(bench.tick() for _ in range(4000))
    assert bench.worst_m < 0.3 * DEVIATION_M


def test_healthy_stage_after_pauses_is_no_fault() -> None:
    """The control loop misses 30 ms of every 100: the setpoint jumps by more than the drive can follow."""
    watch, stage = FollowingWatch(KnownServo(HZ, LIMIT_M_S2)), PlantStage(preset("catheter").stage, 1e-4)
    worst_m = 0.0
    for ms in range(2000):
        if ms % 100 < 70:
            assert watch.read(StageReading(stage.position_m, 0.0), ms * MS) is None
            worst_m = max(worst_m, watch.deviation_m)
            x_m, v_m_s = reach_m(ms * 1e-3), (reach_m(ms * 1e-3 + 1e-4) - reach_m(ms * 1e-3)) * 1e4
            stage.command(x_m, v_m_s, ms * 1e-3)
            watch.command(x_m, v_m_s, ms * MS)
        for step in range(1, 11):
            stage.step(ms * 1e-3 + step * 1e-4)
    assert worst_m < 0.3 * DEVIATION_M


LIARS: dict[str, Liar] = {
    "half motion": lambda ms, x_m, _: x_m if ms < 300 else x_m - 0.5 * (x_m - reach_m(0.3)),
    "stuck": lambda ms, x_m, before_m: x_m if ms < 300 else before_m,
    "slow": lambda ms, x_m, before_m: x_m if ms < 300 else min(x_m, before_m + 20e-6),
    "slipping": lambda ms, x_m, _: x_m if ms < 300 else x_m - 0.2 * (x_m - reach_m(0.3)),
}


@pytest.mark.parametrize("liar", LIARS)
@pytest.mark.parametrize(("expected", "late_ms"), [(EXPECTED[0], 0), (EXPECTED[1], 1e3 * LAG_S)])
def test_lying_stage_is_a_fault_in_time(expected: Expected, late_ms: float, liar: str) -> None:
    """Once it is more than the unknown lag explains: before 0.2 mm, and within 50 ms at 4 mm/s."""
    bench, off_m = Bench(FollowingWatch(expected()), reach_m, LIARS[liar]), 0.0
    while bench.tick() is None:
        off_m = abs(bench.expected_m - bench.x_m)
        assert bench.ms < 300 + 50 + 6 * late_ms
    assert bench.watch.deviation_m < 0.2e-3
    assert late_ms or off_m < 0.2e-3


@pytest.mark.parametrize("hz", [5.0, 10.0, 25.0, 60.0])
@pytest.mark.parametrize("share", [0.2, 1.0])
def test_reaction_of_a_stage_is_measured_in_its_first_second_of_motion(hz: float, share: float) -> None:
    """Of a servo as its settings would say, not as the bound of the readback does."""
    bench = Bench(FollowingWatch(LateStage(LAG_S), StageLag(LAG_S)), lambda t: share * reach_m(t), hz=hz)
    measured = [bench.watch.reaction_s for _ in range(1500) if bench.tick() is None]
    assert measured[800] is None and measured[-1] is not None
    w = 2 * pi * hz
    for measured_s, known_s in zip(measured[-1], (0.5 / w, 1 / (e * w)), strict=True):
        assert 0.6 * known_s - 1e-3 < measured_s < 1.6 * known_s + 1e-3


@pytest.mark.parametrize("late_ms", [20, 50, 100])
def test_reaction_of_a_late_readback_is_no_shorter_than_its_lateness(late_ms: int) -> None:
    watch, sent_m = FollowingWatch(LateStage(0.2), StageLag(0.2)), [0.0] * late_ms
    for ms in range(1500):
        sent_m.append(0.2 * reach_m(ms * 1e-3))
        watch.read(StageReading(sent_m[ms], 0.0), ms * MS)
        watch.command(sent_m[-1], 0.0, ms * MS)
    assert watch.reaction_s is not None
    assert late_ms * 1e-3 <= sum(watch.reaction_s) < 1.8 * late_ms * 1e-3


def test_rest_is_measured() -> None:
    watch, x_m = FollowingWatch(KnownServo(HZ, LIMIT_M_S2)), 0.0
    watch.hold()
    for ms in range(400):
        x_m += 30e-6 if ms < 100 else 0.0
        assert watch.read(StageReading(x_m, 0.0), ms * MS) is None
        assert watch.at_rest is (ms >= 100 + 49), ms


def test_stage_that_does_not_come_to_rest_is_a_fault() -> None:
    watch = FollowingWatch(LateStage(LAG_S))
    for ms in range(100):
        watch.read(StageReading(ms * 1e-5, 0.0), ms * MS)
        watch.command(ms * 1e-5, 0.01, ms * MS)
    watch.hold()
    found = [ms for ms in range(100, 800) if watch.read(StageReading(ms * 1e-5, 0.0), ms * MS)]
    assert found[0] == 600


def test_loop_that_stood_still_finds_the_stage_where_it_is() -> None:
    watch = FollowingWatch(KnownServo(HZ, LIMIT_M_S2))
    watch.read(StageReading(0.0, 0.0), 0)
    watch.command(0.0, 0.2, 0)
    assert watch.read(StageReading(0.01, 0.0), 60 * MS) is None
    watch.command(0.01, 0.0, 60 * MS)
    assert watch.read(StageReading(0.01, 0.0), 61 * MS) is None
