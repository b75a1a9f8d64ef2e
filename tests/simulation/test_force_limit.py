"""The force limit with load cells, stages and loops of other kinds: both ends, fast strokes, a stiff wall."""

import re
from typing import Any

import pytest

from benchmarks.force_limit import CASES, Case
from forefeel.common.events.text import SLOW_LIMIT, ZERO
from forefeel.common.topics import LIMIT_EVENT, SAFETY_EVENT, SLAVE_STATE

SEED = 5
MOST_N = 3.1


def rules(case: Case) -> set[str]:
    return {event.rule for event in case.pair.traffic.messages(LIMIT_EVENT)}


@pytest.mark.parametrize("name", ["cell 50 ms late", "cell of 20 Hz", "filter of 5 Hz", "stage of 8 Hz"])
def test_limit_holds_at_the_speed_that_it_prints_however_late_the_force_is(name: str) -> None:
    case = Case(**CASES[name], seed=SEED)
    case.pair.run(3.2)
    assert 2.5 < case.most_n <= MOST_N
    (armed,) = {e.reason for e in case.pair.traffic.messages(SAFETY_EVENT) if e.event == "engage"}
    claimed = re.search(r"limit 3 N holds up to ([\d.]+) mm/s against walls up to 3000 N/m", armed)
    assert claimed
    assert case.fastest_m_s > 0.6e-3 * float(claimed[1])


def test_a_loop_that_becomes_late_on_the_way_is_said_and_then_a_fault() -> None:
    case = Case(tick_ms=10, late_from_s=3.0, seed=SEED)
    case.pair.run(3.2)
    assert "reading_late" in rules(case)
    case.pair.run(0.6)
    assert case.pair.traffic.times("fault")
    assert case.most_n <= MOST_N


@pytest.mark.parametrize(
    ("settings", "rule"),
    [({"late_ms": 150, "wall_n_m": 10_000.0}, SLOW_LIMIT), (CASES["zero off by -1.5 N"], ZERO)],
)
def test_a_limit_that_leaves_no_speed_or_a_zero_that_is_off_keeps_an_axis_from_arming(
    settings: dict[str, Any], rule: str
) -> None:
    case = Case(**settings, seed=SEED)
    case.pair.run(2.0)
    assert rules(case) == {rule}
    assert not case.pair.traffic.times("engage")


@pytest.mark.parametrize(
    ("name", "most_n"),
    [("10,000 N/m, setting 3000", 5.5), ("1500 N/m, moves 3 mm at 1.2 Hz", 3.4)],
)
def test_a_force_above_its_limit_is_said_at_once_and_of_a_wall_that_moves_the_stage_yields(
    name: str, most_n: float
) -> None:
    case = Case(**CASES[name], seed=SEED)
    case.pair.run(3.0)
    assert 0.0 <= case.said_s < 0.1
    assert 3.15 < case.most_n < most_n
    assert not case.pair.traffic.times("fault")
    assert any(state.over_limit for state in case.pair.traffic.messages(SLAVE_STATE))


def test_a_load_cell_of_the_wrong_sign_is_a_fault_in_the_first_contact() -> None:
    case = Case(**CASES["cell of the wrong sign"], seed=SEED)
    case.pair.run(2.2)
    (reason,) = {e.reason for e in case.pair.traffic.messages(SAFETY_EVENT) if e.event == "fault"}
    assert "load_cell.sign" in reason
    assert case.most_n < 4.6
