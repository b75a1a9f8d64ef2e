"""The haptic loop and its clutch."""

from math import inf, isfinite, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from forefeel.common.estimation.evaluator import nothing_learned
from forefeel.common.messages import Grip, SafetyState
from forefeel.master.handle import HandleReading
from forefeel.master.haptics import Clutch, HapticInputs, HapticLoop, HapticOutputs, NewestForce
from forefeel.master.prediction import Identified
from forefeel.master.rendering import Rendered
from forefeel.master.settings import RenderingSettings
from tests.messages import force
from tests.unit.rigs import FakePredictor

MS = 1_000_000
S = SafetyState
STALE_S = 0.1
SETTINGS = RenderingSettings()
LATE = force(1, 0, (1, 0), force_n=0.7)


NOTHING = Identified(nothing_learned(), None)


class Bench:
    """The loop at 1 kHz, armed and fed with fresh forces unless a test says otherwise; the hand pushes in."""

    def __init__(self, settings: RenderingSettings = SETTINGS) -> None:
        self.predictor = FakePredictor()
        self.loop = HapticLoop(self.predictor, settings)
        self.now_ns = 10_000 * MS
        self.heard_ns: int | None = None
        self.late_ns: int | None = 0
        self.state: S | None = S.ARMED
        self.stage_m: float | None = 0.02
        self.reading = HandleReading(0.1, 0.003, True)
        self.in_session, self.released = True, False

    def tick(self, ticks: int = 1, fresh: bool = True) -> HapticOutputs:
        for _ in range(ticks):
            self.now_ns += MS
            if fresh:
                self.heard_ns = self.now_ns
            newest = None if self.heard_ns is None else NewestForce(LATE, self.heard_ns, self.late_ns)
            inputs = HapticInputs(
                self.reading, self.state, self.stage_m, newest, NOTHING, {}, self.in_session, self.released
            )
            out = self.loop.tick(self.now_ns, inputs)
            position_m, velocity_m_s = self.reading[:2]
            self.reading = self.reading._replace(position_m=position_m + velocity_m_s * 1e-3)
        return out


def test_the_model_is_told_what_is_commanded_and_nothing_before_the_session() -> None:
    bench = Bench()
    bench.in_session = False
    bench.reading = HandleReading(0.1, 0.0, False)
    assert bench.tick().predicted is None
    assert not bench.predictor.asked
    bench.in_session = True
    bench.reading = HandleReading(0.105, 0.003, False)
    out = bench.tick()
    assert bench.predictor.asked[-1][2] == out.velocity_m_s == 0.0  # the stage does not follow this hand
    bench.reading = HandleReading(0.110, 0.003, True)
    out = bench.tick()
    assert bench.predictor.held
    assert out.position_m == pytest.approx(0.02 + 0.110 - 0.105)
    assert bench.predictor.asked[-1] == (bench.now_ns, out.position_m, 0.003)
    assert out.velocity_m_s == 0.003
    bench.released = True
    bench.tick()
    assert not bench.predictor.held


def test_feedback_that_stops_coming_is_felt_for_the_stale_time_and_fades_after_it() -> None:
    bench = Bench()
    bench.tick(300)
    assert bench.tick(100, fresh=False).rendered_n == 1.0
    fading = [bench.tick(fresh=False).rendered_n for _ in range(201)]
    assert all(after < before for before, after in zip([1.0, *fading[:-1]], fading, strict=True) if before)
    assert fading[-1] == 0.0
    assert bench.tick(1000, fresh=False).rendered_n == 0.0


@pytest.mark.parametrize("late_ns", [None, 101 * MS, 480 * MS])
def test_forces_that_keep_coming_but_are_old_by_measurement_are_not_felt(late_ns: int | None) -> None:
    """None: the clocks are not compared."""
    bench = Bench()
    bench.tick(300)
    bench.late_ns = late_ns
    assert bench.tick(200).rendered_n == 0.0
    bench.late_ns, bench.state = 99 * MS, S.ENGAGING
    assert bench.tick(300).rendered_n == 1.0


def test_dead_renderer_or_stale_force_ends_following_until_a_press(monkeypatch: pytest.MonkeyPatch) -> None:
    for dead in (True, False):
        bench = Bench()
        assert bench.tick(500).deadman
        if dead:
            monkeypatch.setattr(bench.loop._renderer, "render", lambda *_: Rendered(0.0, (), 0.0))
        ticks = next(n for n in range(1, 999) if not bench.tick(fresh=dead).deadman)
        assert ticks <= (302 if dead else 602)  # stale after .1 s, faded in .2 s
        bench.reading = bench.reading._replace(deadman=False)
        bench.tick()
        bench.reading = bench.reading._replace(deadman=True)
        assert bench.tick(190).deadman


@pytest.mark.parametrize(
    ("settings", "answer", "state"),
    [
        (RenderingSettings(source="zoh"), 50.0, S.ARMED),  # what is wrong is not felt
        (SETTINGS, 50.0, S.READY),
        (SETTINGS, None, S.ARMED),  # before any is known
        (RenderingSettings(force_scale=0.01), 1.0, S.ARMED),
        (RenderingSettings(force_scale=100.0), 1.0, S.ARMED),
    ],
)
def test_nothing_wrong_lets_following_go_on(
    settings: RenderingSettings, answer: float | None, state: S
) -> None:
    bench = Bench(settings)
    bench.predictor.answer, bench.state = answer, state
    assert all(bench.tick().deadman for _ in range(1000))


def test_a_hand_that_may_not_be_given_energy_feels_nothing_without_an_alarm() -> None:
    bench = Bench()
    bench.reading = HandleReading(0.1, 0.0, True)
    out = bench.tick(1000)
    assert (out.deadman, out.rendered_n) == (True, 0.0)


ANSWER = st.none() | st.floats(-100.0, 100.0) | st.sampled_from([nan, inf, -inf])
STEP = st.tuples(
    ANSWER, st.booleans(), st.booleans(), st.sampled_from([None, *SafetyState]), st.integers(1, 150)
)


@given(st.lists(STEP, min_size=1, max_size=15))
def test_whatever_happens_the_force_is_finite_limited_slewed_and_never_of_stale_feedback(
    steps: list[tuple[float | None, bool, bool, S | None, int]],
) -> None:
    bench = Bench()
    last_live_ns, before_n = 0, 0.0
    for answer, fresh, pressed, state, ticks in steps:
        bench.predictor.answer, bench.state = answer, state
        bench.reading = bench.reading._replace(deadman=pressed)
        for _ in range(ticks):
            out = bench.tick(fresh=fresh)
            heard = bench.heard_ns is not None and bench.now_ns - bench.heard_ns <= STALE_S * 1e9
            if heard and pressed and state in (S.ENGAGING, S.ARMED):
                last_live_ns = bench.now_ns
            assert isfinite(out.rendered_n)
            assert abs(out.rendered_n) <= 4.0
            assert abs(out.rendered_n - before_n) <= 0.08 + 1e-12
            if bench.now_ns - last_live_ns > 201 * MS:
                assert abs(out.rendered_n) < 1e-12
            before_n = out.rendered_n


METRE = st.floats(-1.0, 1.0)


@given(st.lists(st.tuples(METRE, st.booleans(), st.one_of(st.none(), METRE)), min_size=1, max_size=50))
def test_closed_clutch_moves_command_with_handle(steps: list[tuple[float, bool, float | None]]) -> None:
    clutch, before = Clutch(), None
    for handle_m, closed, stage_m in steps:
        command_m = clutch.command_m(HandleReading(handle_m, 0.0, closed), stage_m)
        if closed and before is not None:
            assert abs((command_m - before[0]) - (handle_m - before[1])) < 1e-12
        if not closed and stage_m is not None:
            assert abs(command_m - stage_m) < 1e-12
        before = command_m, handle_m


def test_the_stage_is_expected_where_it_follows_and_stays_where_it_was_let_go() -> None:
    bench = Bench()
    bench.predictor.stage_m = 0.03
    expected_m = []
    for deadman, state, gripper in (
        (False, S.READY, Grip.CLOSED),
        (True, S.READY, Grip.CLOSED),
        (True, S.ARMED, Grip.CLOSED),
        (False, S.ARMED, Grip.CLOSED),
        (False, S.READY, Grip.CLOSED),
        (True, S.ARMED, Grip.OPEN),
    ):
        bench.reading = bench.reading._replace(deadman=deadman, gripper=gripper)
        bench.state = state
        bench.tick()
        expected_m.append(bench.loop.stage_m)
    assert expected_m == [0.02, 0.02, 0.03, 0.03, 0.02, 0.02]


@pytest.mark.parametrize(("settings", "felt_n"), [(SETTINGS, 1.0), (RenderingSettings(source="zoh"), 0.7)])
def test_hand_feels_the_prediction_or_the_late_force(settings: RenderingSettings, felt_n: float) -> None:
    out = Bench(settings).tick(300)
    assert out.predicted is not None
    assert (out.rendered_n, out.predicted.force_n, out.zoh_n, out.hits) == (felt_n, 1.0, 0.7, ())
