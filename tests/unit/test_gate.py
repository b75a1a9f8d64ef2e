from typing import Any

import pytest

from forefeel.common.clock_offset import ClockOffset
from forefeel.common.messages import MOST_POSITION_M, MOST_VELOCITY_M_S, MotionCommand
from forefeel.common.topics import COMMAND
from forefeel.slave.gate import CommandGate, GateLimits, Refusal
from tests.clocks import compared
from tests.messages import SESSION, usual

MS = 1_000_000
S = 1_000_000_000
HOUR_NS = 3600 * S
CLOCK = compared(0, 10 * MS)
LIMITS = GateLimits(max_age_ns=100 * MS, position_m=(-0.05, 0.2), velocity_m_s=2.0)


def command(sequence: int, stamp_ns: int, **changes: Any) -> MotionCommand:  # noqa: ANN401 - any field
    return usual(COMMAND, sequence=sequence, stamp_ns=stamp_ns, **changes)


def opened() -> CommandGate:
    gate = CommandGate(LIMITS)
    gate.open(SESSION)
    return gate


def rule(refusal: Refusal | None) -> str | None:
    return refusal.rule if refusal else None


def stream(gate: CommandGate, count: int, first: int = 1, start_ns: int = S, delay_ns: int = 10 * MS) -> int:
    """Fresh commands at 1 kHz, all admitted; the stamp of the one that would be next."""
    for i in range(count):
        stamp_ns = start_ns + i * MS
        assert gate.admit(command(first + i, stamp_ns), stamp_ns + delay_ns, None) is None
    return start_ns + count * MS


def test_before_a_session_nothing_is_admitted() -> None:
    assert rule(CommandGate(LIMITS).admit(command(1, S), S, None)) == "session"


def test_a_new_session_starts_its_sequence_and_its_base_afresh_and_ends_the_old_one() -> None:
    gate = opened()
    stream(gate, 50)
    gate.open(SESSION + 1)
    assert rule(gate.admit(command(51, 2 * S), 2 * S, None)) == "session"
    assert gate.admit(command(1, 9 * S, session_id=SESSION + 1), 2 * S, None) is None


def test_the_sequence_rises_strictly_and_may_have_holes() -> None:
    gate = opened()
    got = [rule(gate.admit(command(sequence, S), S, None)) for sequence in (0, 1, 2, 2, 1, 5, 4, 6)]
    assert got == ["sequence", None, None, "sequence", "sequence", None, "sequence", None]


def test_a_refusal_says_what_was_asked_and_what_the_limit_is() -> None:
    gate = opened()
    stream(gate, 10)
    assert gate.admit(command(4, S), S, None) == Refusal("sequence", 4, 10, "")
    late = gate.admit(command(11, S), S + 250 * MS, CLOCK)
    assert late is not None
    assert (late.rule, late.unit) == ("late", "s")
    assert (late.requested, late.limit) == pytest.approx((0.240, 0.100))


def test_the_age_limit_counts_from_the_fastest_path_of_the_session() -> None:
    gate = opened()
    stream(gate, 10)
    at_limit_ns = 2 * S + 110 * MS
    assert rule(gate.admit(command(11, 2 * S), at_limit_ns + 1, CLOCK)) == "late"
    assert gate.admit(command(11, 2 * S), at_limit_ns, CLOCK) is None


def test_what_the_clock_comparison_leaves_possible_is_no_future() -> None:
    """One-way delays are unknown: all of the round trip may lie on the way of the answers."""
    gate = opened()
    clock = compared(offset_ns=50 * MS, one_way_ns=50 * MS)  # true offset 0: commands take 0 ms
    for i in range(1, 50):
        assert gate.admit(command(i, S + i * MS), S + i * MS, clock) is None


@pytest.mark.parametrize(("there_ns", "back_ns"), [(400 * MS, 0), (0, 400 * MS), (250 * MS, 10 * MS)])
def test_a_session_whose_clocks_are_compared_first_starts_on_any_split_of_the_round_trip(
    there_ns: int, back_ns: int
) -> None:
    gate, clock = opened(), ClockOffset()
    offset_ns = 5 * S  # master's clock minus the slave's
    clock.update(S, S + back_ns + offset_ns, S + back_ns + offset_ns, S + back_ns + there_ns)
    for i in range(1, 100):
        sent_ns = 2 * S + i * MS
        refusal = gate.admit(command(i, sent_ns + offset_ns), sent_ns + there_ns, clock.best)
        assert refusal is None


@pytest.mark.parametrize("offset_ns", [0, 86_400 * S, -86_400 * S, 2**61])
def test_the_offset_of_the_clocks_cancels(offset_ns: int) -> None:
    gate = opened()
    clock = compared(offset_ns, 20 * MS)
    for i in range(1, 200):
        sent_ns = S + i * MS
        known = clock if i > 50 else None
        assert gate.admit(command(i, sent_ns + offset_ns), sent_ns + 20 * MS, known) is None
    sent_ns = 2 * S
    assert rule(gate.admit(command(200, sent_ns + offset_ns), sent_ns + 121 * MS, clock)) == "late"
    assert rule(gate.admit(command(200, sent_ns + offset_ns + 60 * MS), sent_ns, clock)) == "future"


def test_before_the_clocks_are_compared_the_age_is_not_judged() -> None:
    """Nothing is executed until then, see tests/unit/test_control.py."""
    gate = opened()
    assert gate.admit(command(1, S), 9 * S, None) is None
    assert rule(gate.admit(command(2, S), 9 * S, CLOCK)) == "late"


@pytest.mark.parametrize(
    ("position_m", "velocity_m_s", "expected"),
    [
        (0.2, 2.0, None),
        (-0.05, -2.0, None),
        (0.2000001, 0.0, Refusal("range", 0.2000001, 0.2, "m")),
        (-MOST_POSITION_M, 0.0, Refusal("range", -MOST_POSITION_M, -0.05, "m")),
        (0.0, 2.0000001, Refusal("range", 2.0000001, 2.0, "m/s")),
        (0.0, -MOST_VELOCITY_M_S, Refusal("range", -MOST_VELOCITY_M_S, 2.0, "m/s")),
    ],
)
def test_what_is_beyond_all_reason_is_refused_and_moves_nothing(
    position_m: float, velocity_m_s: float, expected: Refusal | None
) -> None:
    gate = opened()
    asked = command(9, S, position_m=position_m, velocity_m_s=velocity_m_s)
    assert gate.admit(asked, S + 10 * MS, None) == expected
    assert rule(gate.admit(command(9, S), S + 10 * MS, None)) == (None if expected else "sequence")


def test_who_jumped_ahead_is_found_out_by_the_first_fresh_command_of_the_other() -> None:
    gate = opened()
    next_ns = stream(gate, 100)
    assert gate.admit(command(5000, next_ns), next_ns + 10 * MS, None) is None
    assert rule(gate.admit(command(101, next_ns + MS), next_ns + 11 * MS, None)) == "second_writer"


def test_a_command_that_the_network_held_back_is_no_second_writer() -> None:
    gate = opened()
    next_ns = stream(gate, 100)
    assert gate.admit(command(103, next_ns + 2 * MS), next_ns + 12 * MS, None) is None
    assert rule(gate.admit(command(101, next_ns), next_ns + 12 * MS, None)) == "sequence"
    assert rule(gate.admit(command(102, next_ns + MS), next_ns + 12 * MS, None)) == "sequence"


def test_what_was_lost_before_the_session_is_no_gap() -> None:
    gate = opened()
    next_ns = stream(gate, 10, first=5000)
    assert rule(gate.admit(command(7, next_ns + MS), next_ns + 11 * MS, None)) == "sequence"
