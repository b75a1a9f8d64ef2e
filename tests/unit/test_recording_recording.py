from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from forefeel.common.errors import RecordingError
from forefeel.common.recording.recording import Recording


def recording(time_s: ArrayLike, position_m: ArrayLike, force_n: ArrayLike | None = None) -> Recording:
    force = None if force_n is None else np.asarray(force_n)
    return Recording("r", np.asarray(time_s), np.asarray(position_m), force, source="r.csv")


def test_samples_are_float64_copies_that_can_not_be_written() -> None:
    position_m = np.array([0, 1, 2])
    made = recording([0, 1, 2], position_m, [0, 0, 0])
    position_m[0] = 9
    assert made.position_m.tolist() == [0.0, 1.0, 2.0]
    assert made.force_n is not None
    for values in (made.time_s, made.position_m, made.force_n):
        assert values.dtype == np.float64
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 1.0


@given(st.lists(st.floats(0.001, 1.0), min_size=1, max_size=40), st.floats(0.001, 1.0))
def test_segments_hold_every_sample_once_and_no_gap(intervals_s: list[float], gap_s: float) -> None:
    time_s = np.cumsum([0.0, *intervals_s])
    pieces = recording(time_s, time_s).segments(gap_s)
    assert [i for piece in pieces for i in range(piece.start, piece.stop)] == list(range(len(time_s)))
    for piece in pieces:
        assert all(np.diff(time_s[piece]) <= gap_s + 1.1e-6)
    for before, after in pairwise(pieces):
        assert time_s[after.start] - time_s[before.stop - 1] > gap_s


@pytest.mark.parametrize(
    ("time_s", "position_m", "force_n", "expected"),
    [
        ([0.0], [0.0], None, "1 sample(s)"),
        ([0, 1], [0], None, "position_m has shape (1,), expected (2,)"),
        ([0, 1], [0, 1], [0, 1, 2], "force_n has shape (3,), expected (2,)"),
        ([[0, 1]], [[0, 1]], None, "time_s has shape (1, 2), expected (1,)"),
        ([0, 1, np.nan], [0, 1, 2], None, "sample 2, column 'time_s': nan"),
        ([0, 1], [0, -np.inf], None, "sample 1, column 'position_m': -inf"),
        ([0, 1], [0, 1], [np.nan, 0], "sample 0, column 'force_n': nan"),
        ([0, 2, 1], [0, 0, 0], None, "sample 2, column 'time_s': 1.0 after 2.0"),
        ([0, 2, 2], [0, 0, 0], None, "sample 2, column 'time_s': 2.0 after 2.0"),
    ],
)
def test_recording_mistake_is_named_by_its_place(
    time_s: ArrayLike, position_m: ArrayLike, force_n: ArrayLike | None, expected: str
) -> None:
    with pytest.raises(RecordingError) as caught:
        recording(time_s, position_m, force_n)
    assert str(caught.value).startswith(f"r.csv: {expected}")


def test_duration_and_rate_ignore_a_gap_where_they_should_and_a_rounded_interval_is_none() -> None:
    made = recording([1.0, 1.01, 1.02, 5.0, 5.01], [0] * 5)
    assert len(made) == 5
    assert (made.duration_s, made.sampled_s, made.rate_hz) == pytest.approx((4.01, 0.03, 100.0))
    assert recording([0.0, 0.5, 1.0], [0.0] * 3).sampled_s == 1.0
    assert recording([0.1 * i for i in range(50)], [0.0] * 50).segments(0.1) == [slice(0, 50)]
