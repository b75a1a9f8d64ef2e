import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from forefeel.common.error_size import error_size
from forefeel.common.messages import SafetyEvent, SafetyState
from forefeel.common.topics import SAFETY_EVENT
from forefeel.report.score import compare, first_answers, first_of_each, of_one_stretch, spread, stretches
from forefeel.report.states import Span, armed_share, session_end_ns, spans
from forefeel.report.transparency import transparency
from tests.messages import usual

S = SafetyState
BIG = 2**62
Pairs = st.lists(st.tuples(st.integers(BIG, BIG + 2), st.integers(1, 6)), max_size=30)


@given(commands=Pairs, answers=Pairs, seed=st.integers(0, 99))
def test_first_answers_found(
    commands: list[tuple[int, int]], answers: list[tuple[int, int]], seed: int
) -> None:
    commands = list(dict.fromkeys(commands))  # one master stamps no two alike
    commands_ms, answers_ms = ([(i, 4 * ms) for i, ms in pairs] for pairs in (commands, answers))
    stamps = np.random.default_rng(seed).permutation(len(answers))
    first = dict[tuple[int, int], int]()
    for i in np.argsort(stamps).tolist():
        session_id, at_ms = answers_ms[i][0], answers_ms[i][1] + i % 7  # up to 6 ms after a command
        before = [c for c in commands_ms if c[0] == session_id and at_ms - 5 < c[1] <= at_ms]
        answers_ms[i] = session_id, at_ms
        if before:
            first.setdefault(max(before), i)
    found = first_answers(_columns(commands_ms, 1e6), _columns(answers_ms, 1e6), stamps)
    assert found.tolist() == [first.get(command, -1) for command in commands_ms]


def _columns(pairs: list[tuple[int, int]], unit: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    sessions, stamps = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    return sessions, stamps * unit


@given(pairs=Pairs)
def test_first_of_each_agrees_with_a_dictionary(pairs: list[tuple[int, int]]) -> None:
    expected = sorted({pair: i for i, pair in reversed(list(enumerate(pairs)))}.values())
    assert first_of_each(*_columns(pairs)).tolist() == expected


def test_stretches_are_told_apart_by_the_forces_between_them() -> None:
    answers = np.array([np.nan, 1.0, 3.0, np.nan, 5.0, 2.0, np.nan])
    stamps_ns = np.array([0, 1, 3, 4, 6, 2, 7])  # the answer to 2 came late
    assert stretches(answers, stamps_ns).tolist() == [-1, 1, 1, -1, 2, 1, -1]
    assert stretches(np.empty(0), np.empty(0)).tolist() == []


def test_a_command_belongs_to_a_stretch_when_it_was_sent_between_two_that_were_executed_in_it() -> None:
    executed_in = np.array([-1, 1, -1, -1, 1, -1, 2, -1])
    assert np.flatnonzero(of_one_stretch(executed_in)).tolist() == [1, 2, 3, 4, 6]
    assert of_one_stretch(np.array([-1, -1])).tolist() == [False, False]
    assert of_one_stretch(np.empty(0, dtype=np.int64)).tolist() == []


def test_transparency_counts_just_noticeable_differences() -> None:
    true_n = np.array([0.0, 0.1, 2.0, 2.0, np.nan])  # differences of 30, 30, 140 and 140 mN
    found = transparency(true_n + np.array([3, -6, 7, 0, 0]) / 100, true_n + 0.2, true_n)
    assert found.commands == 4 and found.within_jnd == 0.75
    assert found.jnd_rms == pytest.approx(np.sqrt((1.0 + 4.0 + 0.25) / 4))
    assert found.ratio == pytest.approx(np.sqrt((9.0 + 36.0 + 49.0) / 4) / 20.0)


def test_prediction_and_hold_are_scored_on_the_same_commands() -> None:
    nan = np.nan
    predicted_n = np.array([nan, 1.0, 3.0, 9.0, 1.0])
    zoh_n = np.array([5.0, 2.0, nan, 9.0, 3.0])
    comparison = compare(predicted_n, zoh_n, np.array([0.0, 0.0, 0.0, nan, 0.0]))
    assert (comparison.commands, comparison.prediction.rms_n) == (2, 1.0)
    assert comparison.zoh.rms_n == pytest.approx(np.sqrt(6.5))
    assert comparison.ratio == pytest.approx(1 / np.sqrt(6.5))
    assert compare(np.ones(3), np.zeros(3), np.zeros(3)).ratio is None  # a perfect hold


def test_a_model_that_ran_away_still_has_an_error() -> None:
    assert error_size(np.array([1e300, 0.0]), np.zeros(2)).rms_n == pytest.approx(1e300 / np.sqrt(2))
    beyond = error_size(np.array([1.7e308]), np.array([-1.7e308]))
    lacking = error_size(np.array([np.nan, 0.0]), np.zeros(2))
    assert (beyond.max_n, beyond.rms_n, lacking.max_n, lacking.rms_n) == (None, None, None, None)


def test_spread_ignores_what_is_missing() -> None:
    values = np.append(np.arange(1.0, 102.0), np.nan)
    found = spread(values)
    assert (found.p50, found.p99, found.max, found.mean) == pytest.approx((51.0, 100.0, 101.0, 51.0))
    assert spread(np.array([np.nan])).p50 is None


def test_a_silent_slave_is_not_armed() -> None:
    found = spans([(0, S.READY), (10, S.ARMED), (20, S.ARMED), (100, S.READY)], end_ns=110, stale_ns=30)
    ends = [(0, 10, S.READY), (10, 50, S.ARMED), (50, 100, None), (100, 110, S.READY)]
    assert found == [Span(*each) for each in ends]


SECOND_NS = 10**9
ONCE = [(0, S.IDLE), (1, S.READY), (2, S.ARMED), (8, S.READY)]
TWICE = [(0, S.READY), (2, S.ARMED), (4, S.READY), (6, S.ARMED), (9, S.IDLE)]


@pytest.mark.parametrize(
    ("heard", "end_s", "pause_s", "share"),
    [
        (ONCE, 10, 0.0, 6 / 8),  # from the first arming on
        (ONCE, 10, 1.5, 6 / 6.5),  # without the pause that was chosen
        (ONCE, 10, 2.1, 1.0),
        (ONCE, 10, 8.0, None),
        ([*ONCE[:2], (9, S.ARMED)], 20, 0.0, 11 / 14),  # 5 s after the session was opened
        (ONCE[:1], 10, 0.0, None),
        ([], 10, 0.0, None),
        (TWICE, 8, 0.0, 4 / 6),  # until the end of the session
        (TWICE, 3, 0.0, 1.0),
        (TWICE, 2, 0.0, None),
    ],
)
def test_armed_share(heard: list[tuple[int, S]], end_s: int, pause_s: float, share: float | None) -> None:
    last_ns = max(end_s, 10) * SECOND_NS
    found = spans([(at_s * SECOND_NS, state) for at_s, state in heard], last_ns, stale_ns=last_ns)
    assert armed_share(found, end_s * SECOND_NS, pause_s) == pytest.approx(share)


WANTED_NS, HEARD_NS = 80, 90


def transition(event: str) -> SafetyEvent:
    before, after = {
        "engage": (S.READY, S.ENGAGING),
        "engaged": (S.ENGAGING, S.ARMED),
        "at_rest": (S.STOPPING, S.READY),
        "session_lost": (S.READY, S.IDLE),
    }.get(event, (S.ARMED, S.STOPPING))
    return usual(SAFETY_EVENT, before=before, event=event, after=after)


@pytest.mark.parametrize(
    ("happened", "end_ns"),
    [
        ("81 release, 83 at_rest", WANTED_NS),
        ("81 release, 83 at_rest, 99 session_lost", WANTED_NS),  # the master had ended by then
        ("20 watchdog, 21 at_rest, 30 engage, 31 engaged, 81 release, 83 at_rest", WANTED_NS),
        ("40 watchdog, 41 at_rest", HEARD_NS),
        ("40 watchdog, 41 at_rest, 50 session_lost", HEARD_NS),
        ("40 release, 41 at_rest, 50 session_lost", HEARD_NS),  # while the master was there
        ("40 release, 41 at_rest, 50 engage, 51 engaged", HEARD_NS),  # the slave was killed then
        ("5 engage, 6 engaged", HEARD_NS),
        ("", HEARD_NS),
    ],
)
def test_session_ends_when_the_master_lets_go_by_choice_or_is_heard_last(happened: str, end_ns: int) -> None:
    events = [each.split() for each in happened.split(", ") if each]
    transitions = [(int(at_ns), transition(event)) for at_ns, event in events]
    assert session_end_ns(transitions, WANTED_NS, HEARD_NS) == end_ns
    assert session_end_ns(transitions, None, HEARD_NS) == HEARD_NS
