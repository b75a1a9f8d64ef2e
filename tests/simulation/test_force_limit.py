"""The force limit with load cells, stages and loops of other kinds: both ends, fast strokes, a stiff wall."""

import pytest

from benchmarks.force_limit import CASES, Case
from forefeel.common.events.text import SLOW_LIMIT
from forefeel.common.limiter import Reaction, open_speed_m_s
from forefeel.common.topics import LIMIT_EVENT, SAFETY_EVENT, SLAVE_STATE

SEED = 5
MOST_N = 3.1


def rules(case: Case) -> set[str]:
    return {event.rule for event in case.pair.heard.messages(LIMIT_EVENT)}


@pytest.mark.parametrize("name", ["cell 50 ms late", "cell of 20 Hz", "filter of 5 Hz", "stage of 8 Hz"])
def test_limit_holds_at_the_speed_that_it_prints_however_late_the_force_is(name: str) -> None:
    case = Case(**CASES[name], seed=SEED)
    case.pair.run(6.0)
    (state,) = {s.reaction_s for s in case.pair.heard.messages(SLAVE_STATE)[-1:]}
    printed_m_s = open_speed_m_s(case.pair.slave.axes[0].settings.limits, Reaction(*state))
    assert 2.5 < case.most_n <= MOST_N
    assert case.fastest_m_s > 0.6 * printed_m_s
    (armed,) = {e.reason for e in case.pair.heard.messages(SAFETY_EVENT) if e.event == "engage"}
    assert f"{1e3 * printed_m_s:.3g} mm/s against walls up to 3000 N/m" in armed


def test_a_loop_that_becomes_late_on_the_way_is_said_and_then_a_fault() -> None:
    case = Case(**CASES["loop of 10 ms after 5 s"], seed=SEED)
    case.pair.run(5.2)
    assert "reading_late" in rules(case)
    case.pair.run(0.6)
    assert case.pair.heard.times("fault")
    assert case.most_n <= MOST_N


def test_an_axis_whose_force_limit_leaves_no_speed_does_not_arm() -> None:
    case = Case(late_ms=150, wall_n_m=10_000.0, seed=SEED)
    case.pair.run(3.0)
    assert rules(case) == {SLOW_LIMIT}
    assert not case.pair.heard.times("engage")
