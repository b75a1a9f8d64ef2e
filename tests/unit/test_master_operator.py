"""Simulated hands: reaches, tremor, arm, when a person presses and lets go; a recording that is played."""

from itertools import pairwise
from math import sqrt
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from forefeel.common.messages import SafetyState
from forefeel.common.recording.recording import Recording
from forefeel.devices.simulated.operator import (
    REACTION_S,
    Act,
    MinimumJerk,
    Operator,
    SimulatedOperatorPolicy,
    Tremor,
)
from forefeel.devices.simulated.playback import Playback, RecordedMotion
from forefeel.devices.simulated.settings import OperatorSettings
from forefeel.master.handle import HandleReading, Indication

MS = 1_000_000
S = SafetyState
STILL = OperatorSettings(tremor_m=0.0)


class Session:
    """A hand at 1 kHz in front of a slave that arms 50 ms after the press and whose stage follows it."""

    def __init__(self, handle: Operator | Playback, stage_m: float = 0.0) -> None:
        self.handle, self.stage_m = handle, stage_m
        self.now_ns = 5_000 * MS
        self.pressed_ms = 0
        self.readings = list[HandleReading]()

    def run(
        self, seconds: float, state: S | None = None, force_n: float = 0.0, tick_ns: int = MS
    ) -> list[HandleReading]:
        """As READY and ARMED follow from the deadman, or in a given state all the time."""
        begin, end_ns = len(self.readings), self.now_ns + round(seconds * 1000) * MS
        while self.now_ns < end_ns:
            self.now_ns += tick_ns
            shown = state or (S.ARMED if self.pressed_ms > 50 else S.READY)
            self.handle.show(Indication(shown, self.stage_m))
            self.handle.render(force_n, self.now_ns)
            reading = self.handle.read(self.now_ns)
            self.pressed_ms = self.pressed_ms + 1 if reading.deadman else 0
            if reading.deadman and shown is S.ARMED:
                self.stage_m = reading.position_m
            self.readings.append(reading)
        return self.readings[begin:]


def test_strokes_go_in_to_the_depth_and_back_home() -> None:
    settings = STILL
    positions = [reading.position_m for reading in Session(Operator(STILL, 0)).run(30.0)]
    deepest = max(positions)
    assert 0.8 <= (deepest - settings.home_m) / settings.depth_m <= 1.25
    turns = [positions[i] for i in np.flatnonzero(np.diff(np.sign(np.diff(positions)))) + 1]
    strokes = sum(abs(later - before) > 0.015 for before, later in pairwise(turns))
    assert strokes >= 10
    assert min(positions[3000:]) == pytest.approx(settings.home_m, abs=2e-3)


def test_the_rendered_force_pushes_the_hand_back() -> None:
    at_m = list[float]()
    for force_n in (0.0, 2.0):
        session = Session(Operator(STILL, 0))
        session.run(3.0)
        at_m.append(session.run(1.0, S.IDLE, force_n)[-1].position_m)
    assert at_m[0] - at_m[1] == pytest.approx(2.0 / STILL.arm_stiffness_n_m, rel=1e-3)


METRE = st.floats(-0.5, 0.5)
DURATION = st.floats(0.05, 60.0)


@given(METRE, METRE, DURATION)
def test_reach_begins_and_ends_at_rest_where_told(start_m: float, end_m: float, duration_s: float) -> None:
    reach = MinimumJerk(start_m, end_m, duration_s)
    assert reach.at(0.0) == reach.at(-1.0) == (start_m, 0.0)
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


def looked(person: SimulatedOperatorPolicy, now_s: float, state: SafetyState | None) -> Act:
    person.look(now_s, state)
    return person.act


def test_who_is_not_armed_within_three_seconds_lets_go_and_tries_again() -> None:
    person = SimulatedOperatorPolicy()
    person.look(10.0, S.READY)
    assert looked(person, 13.0, S.READY) is Act.PRESSING
    assert looked(person, 13.001, S.READY) is Act.WAITING
    assert looked(person, 13.4, S.READY) is Act.WAITING
    assert looked(person, 13.6, S.READY) is Act.PRESSING


def test_letting_go_by_choice_is_no_stop_and_its_time_is_counted_until_armed() -> None:
    person = SimulatedOperatorPolicy()
    assert looked(person, 10.0, S.READY) is Act.PRESSING
    assert looked(person, 10.3, S.ARMED) is looked(person, 11.0, S.ARMED) is Act.MOVING
    person.release(11.0)
    for i in range(1, 13):
        person.look(11.0 + i * 0.1, S.READY)
    assert person.pressed
    person.look(12.4, S.ARMED)
    person.look(12.9, S.ARMED)
    assert person.clutched_out_s == pytest.approx(1.4)


@given(st.lists(st.tuples(st.floats(0.001, 1.0), st.sampled_from([None, *SafetyState])), max_size=80))
def test_press_waits_for_ready_and_the_reaction(glances: list[tuple[float, SafetyState | None]]) -> None:
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


# --- a recording that is played ---


RATE = np.arange(51) * 0.01  # half a second at 100 Hz
GAPPED = Recording(
    "test",
    np.concatenate([100.0 + RATE, 104.0 + RATE]),
    np.concatenate([0.010 + 0.02 * RATE, 0.060 - 0.03 * RATE]),
    None,
    "test.csv",
)


class Playing(Session):
    def __init__(self) -> None:
        super().__init__(Playback(RecordedMotion(GAPPED), 0.03), stage_m=0.03)

    def play(self, count: int) -> float:
        """Plays on until so many readings were played; time of the last."""
        while len(self.played()) < count:
            self.run(0.001)
        return self.played()[-1].recording_time_s or 0.0

    def played(self) -> list[HandleReading]:
        return [reading for reading in self.readings if reading.recording_time_s is not None]


def test_a_recording_is_cut_into_pieces_at_its_gaps() -> None:
    assert RecordedMotion(GAPPED).pieces == [(100.0, 100.5), (104.0, 104.5)]


def test_a_stop_in_the_middle_goes_on_at_the_same_time_after_it() -> None:
    session = Playing()
    stopped_s = session.play(200)
    session.stage_m += 0.004  # the stage came to rest a little further on
    assert not any(reading.deadman for reading in session.run(0.3, S.STOPPING))
    count = len(session.played())
    session.run(3.0)
    again = session.played()[count]
    assert again.recording_time_s == pytest.approx(stopped_s + 1e-3, abs=1e-9)
    assert again.position_m == RecordedMotion(GAPPED).at(again.recording_time_s or 0.0)[0]


def test_a_late_tick_skips_no_more_than_fifty_milliseconds() -> None:
    session = Playing()
    before_s = session.play(50)
    session.run(0.3, tick_ns=300 * MS)
    assert session.play(0) - before_s == pytest.approx(0.050)
