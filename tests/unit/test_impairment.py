"""The statistics that come out are those asked for; tolerances are 4 to 5 standard errors."""

from itertools import groupby
from math import exp
from statistics import NormalDist, correlation, fmean, pstdev

import pytest

from forefeel.common.transport.impairment import Impairment, ReplayedImpairment
from forefeel.common.transport.settings import ImpairmentSettings

MS = 1_000_000


def plans(
    settings: ImpairmentSettings, count: int, step_ns: int = MS, seed: int = 1
) -> list[tuple[int, ...]]:
    link = Impairment(settings, seed)
    return [link.plan(i * step_ns) for i in range(count)]


def delays_s(settings: ImpairmentSettings, count: int, step_ns: int = MS) -> list[float]:
    return [plan[0] * 1e-9 for plan in plans(settings, count, step_ns) if plan]


def test_independent_jitter_is_a_clipped_normal() -> None:
    settings = ImpairmentSettings(delay_s=0.1, jitter_s=0.01, jitter_correlation_s=0)
    delays = delays_s(settings, 50_000, 100 * MS)
    normal = NormalDist()
    tail = 2 * normal.cdf(-2)
    variance = (1 - tail) - 4 * normal.pdf(2) + 4 * tail  # of a unit normal clipped at +-2
    assert fmean(delays) == pytest.approx(0.1, abs=0.0001)
    assert pstdev(delays) == pytest.approx(0.005 * variance**0.5, rel=0.015)
    assert (min(delays), max(delays)) == pytest.approx((0.09, 0.11))
    assert sum(delay > 0.10999 for delay in delays) / len(delays) == pytest.approx(tail / 2, abs=0.003)


@pytest.mark.parametrize("lag", [1, 5, 20])
def test_correlated_jitter_decays_with_its_time_constant(lag: int) -> None:
    settings = ImpairmentSettings(delay_s=0.1, jitter_s=0.01, jitter_correlation_s=0.1)
    delays = delays_s(settings, 100_000, 20 * MS)
    assert correlation(delays[lag:], delays[:-lag]) == pytest.approx(exp(-lag * 0.02 / 0.1), abs=0.03)


@pytest.mark.parametrize(("share", "length"), [(0.01, 10), (0.1, 3), (0.3, 1), (0.05, 50)])
def test_burst_loss_has_the_asked_share_and_length(share: float, length: float) -> None:
    lost = [not plan for plan in plans(ImpairmentSettings(burst_loss=share, burst_length=length), 400_000)]
    bursts = [len(list(run)) for is_lost, run in groupby(lost) if is_lost]
    assert fmean(lost) == pytest.approx(share, rel=0.25)
    assert fmean(bursts) == pytest.approx(length, rel=0.25)


def test_held_back_messages_are_overtaken_and_no_others() -> None:
    settings = ImpairmentSettings(delay_s=0.02, jitter_s=0.005, reorder=0.05, reorder_hold_s=0.05)
    dues = [i * MS + plan[0] for i, plan in enumerate(plans(settings, 50_000))]
    held = [due for i, due in enumerate(dues) if due - i * MS > 60 * MS]
    kept = [due for i, due in enumerate(dues) if due - i * MS <= 60 * MS]
    assert len(held) / len(dues) == pytest.approx(0.05, abs=0.005)
    assert kept == sorted(kept)


def test_stalls_hold_everything_and_release_it_in_one_burst() -> None:
    settings = ImpairmentSettings(delay_s=0.02, stalls_per_s=1, stall_s=0.1)
    made = plans(settings, 400_000, 5 * MS)
    dues = [i * 5 * MS + plan[0] for i, plan in enumerate(made)]
    bursts = [len(list(run)) for _, run in groupby(dues)]
    stalled = sum(plan[0] > 20 * MS for plan in made) / len(made)
    assert stalled == pytest.approx(0.1 / (1 / 1 + 0.1), rel=0.12)  # of the time, the mean share in a stall
    assert max(plan[0] for plan in made) <= 120 * MS
    assert {length for length in bursts if length > 1} <= {20, 21}  # 100 ms at 5 ms, at the end one more
    assert dues == sorted(dues)


def test_a_replayed_trace_repeats_itself() -> None:
    link = ReplayedImpairment([(1,), (), (2, 3)])
    assert [link.plan(now) for now in range(7)] == [(1,), (), (2, 3), (1,), (), (2, 3), (1,)]
