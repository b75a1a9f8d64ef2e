from itertools import pairwise

import pytest

from forefeel.common.messages import SafetyState
from forefeel.devices.simulated.operator import Operator
from forefeel.devices.simulated.settings import OperatorSettings
from forefeel.master.handle import HandleReading, Indication

MS = 1_000_000
S = SafetyState
STILL = OperatorSettings(tremor_m=0.0)


class Session:
    """An operator at 1 kHz in front of a slave that arms 50 ms after the press; its stage is the handle."""

    def __init__(self, settings: OperatorSettings = STILL, seed: int = 0) -> None:
        self.operator = Operator(settings, seed)
        self.now_ns = 5_000 * MS
        self.pressed_ms = 0
        self.state: S | None = S.READY
        self.stage_m = 0.0
        self.readings = list[HandleReading]()

    def run(self, seconds: float, state: S | None = None, force_n: float = 0.0) -> list[HandleReading]:
        """As READY and ARMED follow from the deadman, or in a given state all the time."""
        begin = len(self.readings)
        for _ in range(round(seconds * 1000)):
            self.now_ns += MS
            self.pressed_ms = self.pressed_ms + 1 if self.operator.person.pressed else 0
            shown = state or (S.ARMED if self.pressed_ms > 50 else S.READY)
            self.operator.show(Indication(shown, self.stage_m))
            self.operator.render(force_n, self.now_ns)
            self.readings.append(self.operator.read(self.now_ns))
        return self.readings[begin:]


def test_the_hand_is_off_the_deadman_until_the_slave_is_ready() -> None:
    session = Session()
    assert not any(reading.deadman for reading in session.run(2.0, S.IDLE))
    assert any(reading.deadman for reading in session.run(0.2))


def test_strokes_go_in_to_the_depth_and_back_home() -> None:
    session = Session()
    settings = STILL
    positions = [reading.position_m for reading in session.run(30.0)]
    deepest = max(positions)
    assert 0.8 <= (deepest - settings.home_m) / settings.depth_m <= 1.25
    turns = [
        b for a, b, c in zip(positions, positions[1:], positions[2:], strict=False) if (b - a) * (c - b) < 0
    ]
    strokes = sum(abs(later - before) > 0.015 for before, later in pairwise(turns))
    assert strokes >= 10
    assert min(positions[3000:]) == pytest.approx(settings.home_m, abs=2e-3)


def test_velocity_is_that_of_the_position() -> None:
    readings = Session(OperatorSettings()).run(5.0)
    for before, after in pairwise(readings[1000:]):
        assert (after.position_m - before.position_m) * 1e3 == pytest.approx(after.velocity_m_s, abs=6e-3)


def test_equal_seeds_move_equally() -> None:
    one, same, other = (Session(OperatorSettings(), seed).run(4.0) for seed in (3, 3, 4))
    assert one == same
    assert one != other


def test_the_rendered_force_pushes_the_hand_back() -> None:
    free, pushed = Session(), Session()
    free.run(3.0)
    pushed.run(3.0)
    free.run(1.0, S.IDLE)
    pushed.run(1.0, S.IDLE, force_n=2.0)
    yielded_m = free.readings[-1].position_m - pushed.readings[-1].position_m
    assert yielded_m == pytest.approx(2.0 / STILL.arm_stiffness_n_m, rel=1e-3)


def test_tremor_rides_on_the_motion() -> None:
    still, shaking = (
        Session(STILL).run(1.0, S.IDLE),
        Session(OperatorSettings(tremor_m=5e-4)).run(1.0, S.IDLE),
    )
    off_m = [abs(a.position_m - b.position_m) for a, b in zip(still, shaking, strict=True)]
    assert 2e-5 < max(off_m) < 5e-4


def test_while_waiting_the_hand_goes_to_the_stage() -> None:
    session = Session()
    session.stage_m = 0.031
    session.run(1.5, S.IDLE)
    assert session.readings[-1].position_m == pytest.approx(0.031, abs=1e-5)


def test_a_stop_cuts_the_stroke_off_and_after_it_the_next_one_begins_where_the_hand_is() -> None:
    session = Session()
    session.run(0.9)
    assert session.readings[-1].velocity_m_s > 0.005
    stopped = session.run(0.4, S.STOPPING)
    assert not any(reading.deadman for reading in stopped)
    assert session.operator.person.stops == 1
    resumed = session.run(3.0)
    assert any(reading.deadman for reading in resumed)
    assert all(abs(b.position_m - a.position_m) < 2e-4 for a, b in pairwise(session.readings))


def test_a_late_tick_does_not_tear_the_hand() -> None:
    session = Session()
    session.run(2.0)
    before_m = session.readings[-1].position_m
    session.now_ns += 2_000 * MS
    session.run(0.001)
    assert abs(session.readings[-1].position_m - before_m) < 0.06 * 0.06


def test_it_never_ends_and_never_chooses_to_wait() -> None:
    session = Session()
    session.run(20.0)
    assert (session.operator.finished, session.operator.clutched_out_s) == (False, 0.0)
