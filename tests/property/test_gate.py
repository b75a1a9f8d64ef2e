from hypothesis import given
from hypothesis import strategies as st

from forefeel.common.clock_offset import OffsetEstimate
from forefeel.common.messages import MOST_POSITION_M, MotionCommand
from forefeel.common.topics import COMMAND
from forefeel.slave.gate import CommandGate, GateLimits
from tests.clocks import compared
from tests.messages import usual

MS = 1_000_000
S = 1_000_000_000
LIMITS = GateLimits(max_age_ns=100 * MS, position_m=(-0.05, 0.2), velocity_m_s=2.0)

ANY = st.builds(
    MotionCommand,
    session_id=st.integers(1, 2),
    sequence=st.integers(0, 60) | st.integers(0, 2**63 - 1),
    stamp_ns=st.integers(0, 3 * S) | st.integers(-(2**63), 2**63 - 1),
    position_m=st.floats(-1, 1) | st.floats(-MOST_POSITION_M, MOST_POSITION_M),
    velocity_m_s=st.floats(-3, 3),
    deadman=st.booleans(),
)
Arrivals = list[tuple[MotionCommand, int, OffsetEstimate | None]]
OFFSET = st.integers(-(10**14), 10**14)
CLOCK = st.none() | st.builds(compared, OFFSET, st.integers(0, 350 * MS))


@given(st.lists(st.tuples(ANY, st.integers(0, 5 * S), CLOCK), max_size=60))
def test_whatever_comes_is_admitted_once_in_order_in_range_or_refused(
    arrivals: Arrivals,
) -> None:
    gate = CommandGate(LIMITS)
    gate.open(1)
    admitted = [c for c, receive_ns, clock in arrivals if gate.admit(c, receive_ns, clock) is None]
    sequences = [c.sequence for c in admitted]
    assert sequences == sorted(set(sequences))
    for c in admitted:
        assert c.session_id == 1
        assert -0.05 <= c.position_m <= 0.2
        assert abs(c.velocity_m_s) <= 2.0


@given(
    OFFSET,
    st.integers(0, 200 * MS),
    st.lists(st.tuples(st.integers(0, 20 * MS), st.integers(0, 3 * S)), min_size=1, max_size=80),
)
def test_on_any_network_nothing_older_than_the_limit_is_admitted_and_nothing_fresh_is_refused(
    offset_ns: int, base_ns: int, messages: list[tuple[int, int]]
) -> None:
    """Excess delay is known here; the gate sees stamps of two clocks only."""
    gate = CommandGate(LIMITS)
    gate.open(1)
    clock = compared(offset_ns, base_ns)
    sent_ns, arrivals = 10 * S, []
    for i, (pause_ns, excess_ns) in enumerate(messages):
        sent_ns += pause_ns
        arrivals.append((sent_ns + base_ns + excess_ns, i + 1, sent_ns, excess_ns))
    newest = 0
    for heard_ns, sequence, stamp_ns, excess_ns in sorted(arrivals):
        asked = usual(COMMAND, session_id=1, sequence=sequence, stamp_ns=stamp_ns + offset_ns)
        admitted = gate.admit(asked, heard_ns, clock) is None
        assert not (admitted and (sequence <= newest or excess_ns > 100 * MS))
        assert admitted or sequence <= newest or excess_ns > 100 * MS
        newest = sequence if admitted else newest


@given(st.lists(st.tuples(ANY, st.integers(0, 5 * S), CLOCK), max_size=30), st.data())
def test_a_refused_command_leaves_no_trace(arrivals: Arrivals, data: st.DataObject) -> None:
    one, other = CommandGate(LIMITS), CommandGate(LIMITS)
    one.open(1)
    other.open(1)
    for asked, receive_ns, clock in arrivals:
        answer = one.admit(asked, receive_ns, clock)
        if answer is None:
            assert other.admit(asked, receive_ns, clock) is None
    probe, receive_ns, clock = data.draw(st.tuples(ANY, st.integers(0, 5 * S), CLOCK))
    assert one.admit(probe, receive_ns, clock) == other.admit(probe, receive_ns, clock)
