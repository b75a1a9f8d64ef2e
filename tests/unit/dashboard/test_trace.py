"""Traces keep peaks, places and their bounds."""

import numpy as np
import pytest

from forefeel.dashboard.timeline import Timeline
from forefeel.dashboard.trace import MinMaxTrace, SampleRing

S = 1_000_000_000
MS = 1_000_000


def test_a_peak_of_one_sample_is_kept_at_its_own_time() -> None:
    trace = MinMaxTrace()
    for tick in range(1000):
        trace.add(tick * 1e-3, 5.0 if tick == 437 else -3.0 if tick == 612 else 0.1)
    rows = trace.since(0).rows
    assert rows[np.argmax(rows[:, 1])].tolist() == [0.437, 5.0]
    assert rows[np.argmin(rows[:, 1])].tolist() == [0.612, -3.0]
    assert len(rows) <= 2 * 50


def test_an_hour_takes_no_more_than_a_minute() -> None:
    trace = MinMaxTrace(span_s=2.0, bin_s=0.02)
    for bin_number in range(50 * 3600):
        trace.add(bin_number * 0.02, float(bin_number))
    points = trace.since(0)
    assert len(points.rows) == 200
    assert points.end == trace.end == 50 * 3600 - 1
    assert points.rows[-1][1] == trace.end - 1
    assert trace.since(trace.end).rows.shape == (0, 2)


def test_a_pause_breaks_the_line_and_what_comes_too_late_is_left_out() -> None:
    trace = MinMaxTrace()
    for t_s in (0.0, 0.05, 1.0, 0.97, 1.05):
        trace.add(t_s, 9.0 if t_s == 0.97 else 1.0)
    rows = trace.since(0).rows
    assert [bool(np.isnan(row[1])) for row in rows] == [False, False, True, False]
    assert 0.05 < rows[2][0] < 1.0
    assert rows[[0, 1, 3], 1].tolist() == [1.0, 1.0, 1.0]


def test_a_ring_holds_the_newest_rows() -> None:
    ring = SampleRing(3, 2)
    assert ring.rows().shape == (0, 2)
    for number in range(5):
        ring.add(number, -number)
    assert ring.rows().tolist() == [[2.0, -2.0], [3.0, -3.0], [4.0, -4.0]]


def test_the_time_of_the_master_goes_on_between_its_words() -> None:
    line = Timeline()
    assert line.add_stamp(5 * S, 100 * S)
    assert not line.add_stamp(6 * S, 101 * S + 3_000_000)  # later by the network's jitter: it moves nothing
    assert line.stamp_s(6 * S) == 1.0
    assert line.now_s(103 * S) == pytest.approx(3.0, abs=4e-3)  # three seconds of 1000 ppm
    assert line.epoch == 1


def test_a_host_that_was_started_again_begins_a_new_time() -> None:
    line = Timeline()
    line.add_stamp(5_000 * S, 100 * S)
    heard = [line.add_stamp(3 * S + n * MS, 160 * S + n * MS) for n in range(52)]
    assert heard == [None] * 50 + [True, False]
    assert line.epoch == 2
    assert line.stamp_s(3 * S + 50 * MS) == 0.0


@pytest.mark.parametrize("ahead_s", [1, 9, 3600])
def test_a_lone_stamp_from_the_future_moves_no_time(ahead_s: int) -> None:
    line = Timeline()
    line.add_stamp(5 * S, 100 * S)
    assert line.add_stamp((6 + ahead_s) * S, 101 * S) is None
    assert not line.add_stamp(6 * S + MS, 101 * S + MS)
    assert line.now_s(101 * S + MS) == pytest.approx(1.0, abs=4e-3)
    assert line.epoch == 1


def test_clocks_may_drift_apart_for_an_hour() -> None:
    line, anew = Timeline(), 0
    for second in range(3600):
        stamp_ns = second * S
        anew += bool(line.add_stamp(stamp_ns, 100 * S + round(stamp_ns * (1 + 50e-6))))
    assert anew == 1
    assert line.now_s(100 * S + round(3599 * S * (1 + 50e-6))) == pytest.approx(3599.0, abs=1e-3)
