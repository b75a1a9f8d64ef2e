from hypothesis import given
from hypothesis import strategies as st

from forefeel.common.transport.impairment import Impairment, ReplayedImpairment
from forefeel.common.transport.settings import ImpairmentSettings

SHARES = st.floats(0, 0.5)
SECONDS = st.floats(0, 1)


@st.composite
def all_settings(draw: st.DrawFn) -> ImpairmentSettings:
    delay_s = draw(SECONDS)
    return ImpairmentSettings(
        delay_s=delay_s,
        jitter_s=draw(st.floats(0, delay_s)),
        jitter_correlation_s=draw(SECONDS),
        loss=draw(SHARES),
        burst_loss=draw(SHARES),
        burst_length=draw(st.floats(1, 100)),
        reorder=draw(SHARES),
        reorder_hold_s=draw(SECONDS),
        duplicate=draw(SHARES),
        stalls_per_s=draw(st.floats(0, 5)),
        stall_s=draw(SECONDS),
    )


GAPS = st.lists(st.integers(0, 10**9), min_size=1, max_size=60)
ORIGINS = st.integers(-(10**15), 10**15)


def stamps(origin_ns: int, gaps_ns: list[int]) -> list[int]:
    return [origin_ns + sum(gaps_ns[: i + 1]) for i in range(len(gaps_ns))]


@given(all_settings(), st.integers(), ORIGINS, GAPS)
def test_the_plan_depends_on_seed_and_arrivals_only_and_not_on_the_origin_of_time(
    settings: ImpairmentSettings, seed: int, origin_ns: int, gaps_ns: list[int]
) -> None:
    first, second = Impairment(settings, seed), Impairment(settings, seed)
    assert [first.plan(now) for now in stamps(0, gaps_ns)] == [
        second.plan(now) for now in stamps(origin_ns, gaps_ns)
    ]


@given(all_settings(), st.integers(), ORIGINS, GAPS)
def test_delays_stay_in_their_bounds(
    settings: ImpairmentSettings, seed: int, origin_ns: int, gaps_ns: list[int]
) -> None:
    link = Impairment(settings, seed)
    # A message may have to wait for its predecessor, which came as late as this.
    longest_s = settings.delay_s + settings.jitter_s + settings.stall_s + settings.reorder_hold_s
    for now_ns in stamps(origin_ns, gaps_ns):
        delays_ns = link.plan(now_ns)
        assert len(delays_ns) <= 2
        assert all(0 <= delay_ns <= longest_s * 1e9 + 2 for delay_ns in delays_ns)
        assert all(delay_ns >= (settings.delay_s - settings.jitter_s) * 1e9 - 2 for delay_ns in delays_ns)


@given(all_settings(), st.integers(), GAPS)
def test_without_reordering_the_order_is_kept(
    settings: ImpairmentSettings, seed: int, gaps_ns: list[int]
) -> None:
    link = Impairment(settings.model_copy(update={"reorder": 0.0}), seed)
    dues = [now_ns + delay_ns for now_ns in stamps(0, gaps_ns) for delay_ns in link.plan(now_ns)]
    assert dues == sorted(dues)


@given(all_settings(), st.integers(), GAPS)
def test_a_recorded_trace_replays(settings: ImpairmentSettings, seed: int, gaps_ns: list[int]) -> None:
    original = Impairment(settings, seed)
    trace = [original.plan(now_ns) for now_ns in stamps(0, gaps_ns)]
    replayed = ReplayedImpairment(trace)
    assert [replayed.plan(now_ns) for now_ns in stamps(7, gaps_ns)] == trace
