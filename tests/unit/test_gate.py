from itertools import pairwise
from typing import Any

import pytest

from common.clock_offset import ClockOffset, OffsetEstimate
from common.messages import MotionCommand
from slave.gate import CommandGate, GateLimits, Refusal

MS = 1_000_000
S = 1_000_000_000
HOUR_NS = 3600 * S
SESSION = 77
LIMITS = GateLimits(max_age_ns=100 * MS, position_m=(-0.05, 0.2), velocity_m_s=2.0)


def command(sequence: int, stamp_ns: int, **changes: Any) -> MotionCommand:  # noqa: ANN401 - any field
    fields = {"session_id": SESSION, "position_m": 0.0, "velocity_m_s": 0.0, "deadman": True, **changes}
    return MotionCommand(sequence=sequence, stamp_ns=stamp_ns, **fields)


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


# --- session ---


def test_before_a_session_nothing_is_admitted() -> None:
    assert rule(CommandGate(LIMITS).admit(command(1, S), S, None)) == "session"


@pytest.mark.parametrize("session_id", [0, SESSION + 1, 2**63 - 1])
def test_commands_of_another_session_are_refused_and_move_nothing(session_id: int) -> None:
    gate = opened()
    assert rule(gate.admit(command(500, S, session_id=session_id), S, None)) == "session"
    assert gate.admit(command(1, S), S, None) is None


def test_a_new_session_starts_its_sequence_and_its_base_afresh_and_ends_the_old_one() -> None:
    gate = opened()
    stream(gate, 50)
    gate.open(SESSION + 1)
    assert rule(gate.admit(command(51, 2 * S), 2 * S, None)) == "session"
    assert gate.admit(command(1, 9 * S, session_id=SESSION + 1), 2 * S, None) is None


# --- sequence ---


def test_the_sequence_rises_strictly_and_may_have_holes() -> None:
    gate = opened()
    got = [rule(gate.admit(command(sequence, S), S, None)) for sequence in (1, 2, 2, 1, 5, 4, 3, 6)]
    assert got == [None, None, "sequence", "sequence", None, "sequence", "sequence", None]


def test_sequence_zero_is_never_admitted() -> None:
    assert rule(opened().admit(command(0, S), S, None)) == "sequence"


def test_a_replay_of_the_whole_session_is_refused() -> None:
    gate = opened()
    recorded = [command(i, S + i * MS) for i in range(1, 101)]
    assert all(gate.admit(c, c.stamp_ns + MS, None) is None for c in recorded)
    replayed = [gate.admit(c, c.stamp_ns + MS + 50 * MS, None) for c in recorded]
    assert {rule(refusal) for refusal in replayed} == {"sequence"}


def test_a_refusal_says_what_was_asked_and_what_the_limit_is() -> None:
    gate = opened()
    stream(gate, 10)
    assert gate.admit(command(4, S), S, None) == Refusal("sequence", 4, 10, "")
    late = gate.admit(command(11, S), S + 250 * MS, None)
    assert late is not None
    assert (late.rule, late.unit) == ("late", "s")
    assert (late.requested, late.limit) == pytest.approx((0.240, 0.100), rel=2e-4)  # drift


# --- age ---


@pytest.mark.parametrize("clock", [None, OffsetEstimate(0, 10 * MS)])
def test_the_age_limit_counts_from_the_smallest_transit_but_for_drift(clock: OffsetEstimate | None) -> None:
    gate = opened()
    stream(gate, 10)
    at_limit_ns = 2 * S + 110 * MS
    drift_ns = (at_limit_ns - (S + 19 * MS)) // 10_000  # 100 ppm since the smallest
    assert rule(gate.admit(command(11, 2 * S), at_limit_ns + drift_ns + 20, clock)) == "late"
    assert gate.admit(command(11, 2 * S), at_limit_ns + drift_ns, clock) is None


@pytest.mark.parametrize("compared", [False, True], ids=["clocks not compared", "clocks compared"])
@pytest.mark.parametrize("stall_ns", [150 * MS, 2 * S, 10 * S])
def test_of_the_burst_after_a_stall_nothing_older_than_the_limit_is_admitted(
    compared: bool, stall_ns: int
) -> None:
    gate = opened()
    clock = OffsetEstimate(0, 10 * MS) if compared else None
    stalled_ns = stream(gate, 200)
    wakes_ns = stalled_ns + stall_ns
    burst = [command(201 + i, stalled_ns + i * MS) for i in range((stall_ns - 10 * MS) // MS)]
    admitted = [c for i, c in enumerate(burst) if gate.admit(c, wakes_ns + i * 1000, clock) is None]
    assert all(wakes_ns - c.stamp_ns <= 110 * MS for c in admitted)
    assert len(admitted) <= 100
    assert len(burst) - len(admitted) >= (stall_ns - 130 * MS) // MS


def test_of_an_old_burst_none_is_admitted_and_the_next_fresh_one_is() -> None:
    gate = opened()
    stalled_ns = stream(gate, 200)
    burst = [command(201 + i, stalled_ns + i * MS) for i in range(1900)]
    received_ns = stalled_ns + 2 * S + 10 * MS
    assert {rule(gate.admit(c, received_ns + 1000 * i, None)) for i, c in enumerate(burst)} == {"late"}
    fresh_ns = received_ns + 2 * MS
    assert gate.admit(command(2101, fresh_ns), fresh_ns + 10 * MS, None) is None


def test_a_session_that_begins_with_an_old_burst_executes_none_of_it_once_clocks_are_compared() -> None:
    gate = opened()
    clock = OffsetEstimate(0, 10 * MS)
    burst = [command(i, S + i * MS) for i in range(1, 1900)]
    assert {rule(gate.admit(c, S + 2 * S + 50 * MS, clock)) for c in burst} == {"late"}
    assert gate.admit(command(2000, 4 * S), 4 * S + 10 * MS, clock) is None


# --- future ---


@pytest.mark.parametrize("ahead_ns", [60 * MS, S, HOUR_NS, 2**62])
def test_a_stamp_from_the_future_is_refused_and_moves_nothing(ahead_ns: int) -> None:
    gate = opened()
    clock = OffsetEstimate(0, 10 * MS)
    next_ns = stream(gate, 100)
    forged = command(10**6, next_ns + ahead_ns)
    assert rule(gate.admit(forged, next_ns, clock)) == "future"
    for i in range(100):  # neither the sequence nor the base has moved
        stamp_ns = next_ns + i * MS
        assert gate.admit(command(101 + i, stamp_ns), stamp_ns + 10 * MS, clock) is None


def test_without_a_clock_a_stamp_that_is_too_early_is_refused_as_well() -> None:
    gate = opened()
    next_ns = stream(gate, 100)
    assert rule(gate.admit(command(101, next_ns + S), next_ns + 10 * MS, None)) == "future"
    assert gate.admit(command(101, next_ns), next_ns + 10 * MS, None) is None


def test_what_the_clock_comparison_leaves_possible_is_no_future() -> None:
    """One-way delays are unknown: all of the round trip may lie on the way of the answers."""
    gate = opened()
    clock = OffsetEstimate(offset_ns=50 * MS, bound_ns=50 * MS)  # true offset 0: commands take 0 ms
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


# --- offset and drift ---


@pytest.mark.parametrize("offset_ns", [0, 86_400 * S, -86_400 * S, 2**61])
def test_the_offset_of_the_clocks_cancels(offset_ns: int) -> None:
    gate = opened()
    clock = OffsetEstimate(offset_ns, 20 * MS)
    for i in range(1, 200):
        sent_ns = S + i * MS
        known = clock if i > 50 else None
        assert gate.admit(command(i, sent_ns + offset_ns), sent_ns + 20 * MS, known) is None
    sent_ns = 2 * S
    assert rule(gate.admit(command(200, sent_ns + offset_ns), sent_ns + 121 * MS, clock)) == "late"
    assert rule(gate.admit(command(200, sent_ns + offset_ns + 60 * MS), sent_ns, clock)) == "future"


@pytest.mark.parametrize("drift_ppm", [100, -100])
@pytest.mark.parametrize("delay_ns", [MS // 10, 30 * MS])
def test_an_hour_of_drift_refuses_no_command(drift_ppm: int, delay_ns: int) -> None:
    """Both clocks' comparison and the base follow: 100 ppm are 360 ms in an hour."""
    gate, clock = opened(), ClockOffset()

    def masters(stamp_ns: int) -> int:
        return stamp_ns + stamp_ns * drift_ppm // 1_000_000

    for i in range(1, 18_000):
        sent_ns = i * 200 * MS
        heard_ns = sent_ns + delay_ns + i % 5 * delay_ns // 20  # a little jitter
        refusal = gate.admit(command(i, masters(sent_ns)), heard_ns, clock.best)
        assert refusal is None, f"after {sent_ns / S} s: {refusal}"
        if i % 5 == 0:
            t1, t4 = heard_ns, heard_ns + 2 * delay_ns
            clock.update(t1, masters(t1 + delay_ns), masters(t1 + delay_ns), t4)


def test_after_an_hour_of_drift_late_is_still_late() -> None:
    gate = opened()
    drifted = [(i * 200 * MS, i * 200 * MS + i * 20_000) for i in range(1, 18_000)]
    for i, (sent_ns, heard_ns) in enumerate(drifted, start=1):
        assert gate.admit(command(i, sent_ns), heard_ns, None) is None
    sent_ns, heard_ns = drifted[-1]
    assert rule(gate.admit(command(18_000, sent_ns), heard_ns + 107 * MS, None)) == "late"


@pytest.mark.parametrize("creep_s_s", [1.5e-3, 0.3e-3])
def test_a_delay_that_creeps_up_is_refused_in_the_end_and_stays_refused(creep_s_s: float) -> None:
    """No clock drifts by more than 0.1 ms in a second: this is the network."""
    gate, answers = opened(), list[str | None]()
    for i in range(1, 60_001):
        sent_ns = i * 10 * MS
        transit_ns = 150 * MS + round(sent_ns * creep_s_s)
        answers.append(rule(gate.admit(command(i, sent_ns), sent_ns + transit_ns, None)))
    first_late = answers.index("late")
    excess_s = first_late * 0.010 * (creep_s_s - 1e-4)
    assert excess_s == pytest.approx(0.100, rel=0.01)
    assert set(answers[first_late:]) == {"late"}


def test_the_base_is_not_forgotten_in_a_long_session() -> None:
    gate = opened()
    stamp_ns = stream(gate, 10, delay_ns=10 * MS)
    for i in range(600):  # a minute of 90 ms more
        sent_ns = stamp_ns + i * 100 * MS
        assert gate.admit(command(11 + i, sent_ns), sent_ns + 100 * MS, None) is None
    sent_ns = stamp_ns + 60 * S
    assert rule(gate.admit(command(1000, sent_ns), sent_ns + 117 * MS, None)) == "late"


# --- range ---


@pytest.mark.parametrize(
    ("position_m", "velocity_m_s", "expected"),
    [
        (0.2, 2.0, None),
        (-0.05, -2.0, None),
        (0.2000001, 0.0, Refusal("range", 0.2000001, 0.2, "m")),
        (-1e300, 0.0, Refusal("range", -1e300, -0.05, "m")),
        (0.0, 2.0000001, Refusal("range", 2.0000001, 2.0, "m/s")),
        (0.0, -1e308, Refusal("range", -1e308, 2.0, "m/s")),
    ],
)
def test_what_is_beyond_all_reason_is_refused_and_moves_nothing(
    position_m: float, velocity_m_s: float, expected: Refusal | None
) -> None:
    gate = opened()
    asked = command(9, S, position_m=position_m, velocity_m_s=velocity_m_s)
    assert gate.admit(asked, S + 10 * MS, None) == expected
    assert rule(gate.admit(command(9, S), S + 10 * MS, None)) == (None if expected else "sequence")


def test_stamps_may_be_negative() -> None:
    gate = opened()
    stamps = [-(2**63) + i * MS for i in range(50)]
    assert all(gate.admit(command(i, stamp), S + i * MS, None) is None for i, stamp in enumerate(stamps, 1))
    assert all(before < after for before, after in pairwise(stamps))


# --- two writers ---


def test_a_used_number_with_a_newer_stamp_is_a_replay_with_a_new_coat() -> None:
    gate = opened()
    next_ns = stream(gate, 100)
    assert rule(gate.admit(command(50, next_ns), next_ns + 10 * MS, None)) == "sequence"


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
