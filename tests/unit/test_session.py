from hypothesis import given
from hypothesis import strategies as st

from forefeel.slave.session import Lease

MS = 1_000_000
LEASE_NS = 1000 * MS


def held(session_id: int = 7, now_ns: int = 0) -> Lease:
    lease = Lease(LEASE_NS)
    assert lease.request(session_id, now_ns, at_rest=True) is None
    return lease


def test_the_first_heartbeat_may_take_a_round_trip_more_than_the_next() -> None:
    lease = Lease(LEASE_NS, 2000 * MS)
    lease.request(7, 0, at_rest=True)
    assert (lease.renewed, lease.expired_after_s, lease.live(3000 * MS)) == (False, 3.0, False)
    assert lease.renew(7, 2999 * MS)
    assert (lease.renewed, lease.expired_after_s) == (True, 1.0)
    assert lease.live(3998 * MS)
    assert not lease.live(3999 * MS)
    lease.request(8, 4000 * MS, at_rest=True)
    assert (lease.renewed, lease.live(6999 * MS)) == (False, True)


def test_heartbeats_of_the_holder_renew_it_and_no_others() -> None:
    lease = held(7)
    assert lease.renew(7, 900 * MS)
    assert lease.live(900 * MS + LEASE_NS - 1)
    assert not lease.renew(8, 1000 * MS)
    assert not lease.live(900 * MS + LEASE_NS)


def test_a_lease_that_was_let_go_is_over_and_free_and_its_id_used_up() -> None:
    lease = held(7)
    lease.release(500 * MS)
    assert not lease.live(500 * MS)
    assert not lease.renew(7, 500 * MS)
    assert lease.request(7, 500 * MS, at_rest=True) == "this session id was used before"
    assert lease.request(8, 500 * MS, at_rest=True) is None


def test_a_repeated_request_of_the_holder_is_harmless_and_does_not_renew() -> None:
    lease = held(7)
    assert lease.request(7, 500 * MS, at_rest=False) is None
    assert not lease.live(LEASE_NS)


def test_an_id_is_never_accepted_twice_however_many_follow() -> None:
    lease = Lease(LEASE_NS)
    for i in range(1, 5000):
        assert lease.request(i, i * LEASE_NS, at_rest=True) is None
    for i in (1, 2, 2500, 4999):
        assert lease.request(i, 9999 * LEASE_NS, at_rest=True) == "this session id was used before"


ACTS = st.lists(
    st.tuples(st.booleans(), st.integers(0, 4), st.integers(0, 2000 * MS), st.booleans()), max_size=40
)


@given(ACTS)
def test_there_is_one_writer_at_a_time_and_no_id_returns(acts: list[tuple[bool, int, int, bool]]) -> None:
    lease, now_ns = Lease(LEASE_NS), 0
    ended = set[int]()
    for asks, session_id, pause_ns, at_rest in acts:
        now_ns += pause_ns
        holder, was_live = lease.holder, lease.live(now_ns)
        if asks:
            granted = lease.request(session_id, now_ns, at_rest) is None
            if granted and session_id != holder:
                assert at_rest and not was_live and session_id not in ended | {0}
                ended.add(holder)
            assert granted == (lease.live(now_ns) and lease.holder == session_id)
        else:
            renewed = lease.renew(session_id, now_ns)
            assert renewed == (was_live and session_id == holder)
            assert lease.live(now_ns) == was_live
