"""The synthetic operator: reaches, tremor, arm, and when the person presses and lets go."""

from itertools import pairwise
from math import sqrt
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from forefeel.common.messages import SafetyState
from forefeel.devices.simulated.operator import (
    REACTION_S,
    Act,
    MinimumJerk,
    Operator,
    SimulatedOperatorPolicy,
    Tremor,
)
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


def test_the_rendered_force_pushes_the_hand_back() -> None:
    free, pushed = Session(), Session()
    free.run(3.0)
    pushed.run(3.0)
    free.run(1.0, S.IDLE)
    pushed.run(1.0, S.IDLE, force_n=2.0)
    yielded_m = free.readings[-1].position_m - pushed.readings[-1].position_m
    assert yielded_m == pytest.approx(2.0 / STILL.arm_stiffness_n_m, rel=1e-3)


METRE = st.floats(-0.5, 0.5)
DURATION = st.floats(0.05, 60.0)


@given(METRE, METRE, DURATION)
def test_a_reach_begins_and_ends_at_rest_where_it_is_told(
    start_m: float, end_m: float, duration_s: float
) -> None:
    reach = MinimumJerk(start_m, end_m, duration_s)
    assert reach.at(0.0) == (start_m, 0.0)
    assert reach.at(-1.0) == (start_m, 0.0)
    position_m, velocity_m_s = reach.at(duration_s)
    assert position_m == pytest.approx(end_m, abs=1e-12)
    assert velocity_m_s == 0.0
    assert reach.at(duration_s + 5.0) == (position_m, velocity_m_s)
    middle_m, peak_m_s = reach.at(duration_s / 2)
    assert middle_m == pytest.approx((start_m + end_m) / 2, abs=1e-12)
    assert peak_m_s == pytest.approx(1.875 * (end_m - start_m) / duration_s, rel=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_tremor_is_between_6_and_12_hz_and_within_its_amplitude(seed: int) -> None:
    tremor, rate_hz, seconds = Tremor(2e-4, Random(seed)), 200.0, 40.0
    t = np.arange(0.0, seconds, 1.0 / rate_hz)
    x = np.array([tremor.at(s)[0] for s in t])
    assert np.abs(x).max() <= 2e-4
    power = np.abs(np.fft.rfft(x * np.hanning(len(x)))) ** 2
    hz = np.fft.rfftfreq(len(x), 1.0 / rate_hz)
    band = (hz > 5.8) & (hz < 12.2)
    assert power[band].sum() > 0.999 * power.sum()
    assert np.sqrt(np.mean(x**2)) == pytest.approx(sqrt(3 / 2) * 2e-4 / 3, rel=0.1)


STATES = (None, *SafetyState)


def looked(person: SimulatedOperatorPolicy, now_s: float, state: SafetyState | None) -> Act:
    person.look(now_s, state)
    return person.act


def armed(now_s: float = 10.0) -> SimulatedOperatorPolicy:
    person = SimulatedOperatorPolicy()
    assert looked(person, now_s, S.READY) is Act.PRESSING
    assert looked(person, now_s + 0.3, S.ARMED) is Act.MOVING
    return person


def test_who_is_not_armed_within_three_seconds_lets_go_and_tries_again() -> None:
    person = SimulatedOperatorPolicy()
    person.look(10.0, S.READY)
    assert looked(person, 13.0, S.READY) is Act.PRESSING
    assert looked(person, 13.001, S.READY) is Act.WAITING
    assert looked(person, 13.4, S.READY) is Act.WAITING
    assert looked(person, 13.6, S.READY) is Act.PRESSING


def test_letting_go_by_choice_is_no_stop_and_its_time_is_counted_until_armed() -> None:
    person = armed(10.0)
    person.look(11.0, S.ARMED)
    person.release(11.0)
    for i in range(1, 13):
        person.look(11.0 + i * 0.1, S.READY)
    assert person.pressed
    person.look(12.4, S.ARMED)
    person.look(12.9, S.ARMED)
    assert person.clutched_out_s == pytest.approx(1.4)


@given(st.lists(st.tuples(st.floats(0.001, 1.0), st.sampled_from(STATES)), max_size=80))
def test_a_press_begins_at_ready_only_and_never_sooner_than_the_reaction(
    glances: list[tuple[float, SafetyState | None]],
) -> None:
    person, now_s = SimulatedOperatorPolicy(), 100.0
    released_s = now_s - REACTION_S
    for pause_s, state in glances:
        now_s += pause_s
        was = person.act
        act = looked(person, now_s, state)
        if was is Act.WAITING and act is Act.PRESSING:
            assert state is S.READY
            assert now_s - released_s >= REACTION_S - 1e-9
        if act is Act.MOVING:
            assert state is S.ARMED
        if was is not Act.WAITING and act is Act.WAITING:
            released_s = now_s
