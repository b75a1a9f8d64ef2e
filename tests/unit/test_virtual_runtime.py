from functools import partial

from hypothesis import given
from hypothesis import strategies as st

from forefeel.common.runtime.virtual import VirtualRuntime

MS = 1_000_000
START_NS = 1_000_000_000


def test_events_of_one_stamp_run_in_the_order_of_their_scheduling() -> None:
    runtime, order = VirtualRuntime(), list[str]()
    runtime.timers.call_at(START_NS + MS, lambda: order.append("timer before"))
    runtime.loop("a", MS, lambda _: order.append("a"))
    runtime.task("b", MS, lambda _: order.append("b"))
    runtime.timers.call_at(START_NS + MS, lambda: order.append("timer after"))
    runtime.run(2 * MS)
    assert order == ["timer before", "a", "b", "timer after", "a", "b"]


def test_progress_every_tenth_of_a_second_until_it_says_no() -> None:
    runtime, ticks, reports = VirtualRuntime(), list[int](), list[int]()
    runtime.task("task", MS, ticks.append)

    def progress(now_ns: int) -> bool:
        reports.append((now_ns - START_NS) // MS)
        return len(reports) < 4

    runtime.run(1000 * MS, progress)
    assert reports == [1, 101, 201, 301]
    assert len(ticks) == 301
    runtime.run(MS)
    assert len(ticks) == 302


@given(st.lists(st.tuples(st.integers(0, 20), st.integers(0, 99)), max_size=40))
def test_timers_run_by_stamp_then_by_order(asked: list[tuple[int, int]]) -> None:
    runtime, seen = VirtualRuntime(), list[tuple[int, int]]()
    for entry in asked:
        runtime.call_at(START_NS + entry[0] * MS, partial(seen.append, entry))
    runtime.run(20 * MS)
    assert seen == sorted(asked, key=lambda entry: entry[0])
