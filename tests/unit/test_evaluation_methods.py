import numpy as np
import pytest

from forefeel.diagnosis.evaluation.arrivals import DelayedLink, arrivals
from forefeel.diagnosis.evaluation.methods import LONGEST_LATENESS_S, METHODS, MethodEstimate, Pairs
from forefeel.diagnosis.evaluation.replay import replay
from tests.unit.evaluation_samples import Floats, hold_oracle, made_up, recording


@pytest.mark.parametrize("delay_s", [0.0, 0.02, 0.3, 0.5])
@pytest.mark.parametrize("uneven", [0.0, 0.3])
def test_the_hold_is_its_definition(delay_s: float, uneven: float) -> None:
    sample = made_up(duration_s=5.0, uneven=uneven)
    assert sample.force_n is not None
    trace = replay(sample, arrivals(sample.time_s, DelayedLink(delay_s)), METHODS["zoh"](None))
    expected = hold_oracle(sample.time_s, sample.force_n, delay_s)
    np.testing.assert_array_equal(trace.force_n, expected)
    np.testing.assert_array_equal(trace.answered, np.isfinite(expected))


def test_the_hold_keeps_the_newest_stamp_whatever_the_order() -> None:
    hold = METHODS["zoh"](None)
    assert hold.predict() is None
    for stamp_s, force_n in (1.0, 10.0), (3.0, 30.0), (2.0, 20.0):
        hold.observe(stamp_s, force_n)
    hold.restart()
    hold.move(4.0, 0.0)
    assert hold.predict() == MethodEstimate(30.0)


def paper_oracle(time_s: Floats, x: Floats, force_n: Floats, delay_s: float) -> Floats:
    """Weighted batch least squares at every stamp: equations (8) to (12) written out as one sum."""
    lam, n = 0.96, len(time_s)
    v = np.append(np.nan, np.diff(x) / np.diff(time_s))
    a = np.append(np.nan, np.diff(v) / np.diff(time_s))
    phi = np.column_stack((a, v, x))
    said = np.full(n, np.nan)
    for k in range(n):
        known = np.flatnonzero((time_s <= time_s[k] - delay_s) & np.isfinite(a))
        weights = np.sqrt(lam ** np.arange(len(known) - 1, -1, -1))
        prior = np.sqrt(1e-6 * lam ** len(known)) * np.eye(3)
        rows = np.vstack((prior, weights[:, None] * phi[known]))
        y = np.append(np.zeros(3), weights * force_n[known])
        said[k] = phi[k] @ np.linalg.lstsq(rows, y, rcond=None)[0]
    return said


def test_the_paper_is_weighted_least_squares_on_causal_differences() -> None:
    sample = made_up(duration_s=3.0, gap_s=0.0)
    assert sample.force_n is not None
    trace = replay(sample, arrivals(sample.time_s, DelayedLink(0.3)), METHODS["paper"](None))
    expected = paper_oracle(sample.time_s, sample.position_m, sample.force_n, 0.3)
    late = sample.time_s > 1.0  # before, the prior and rounding matter
    np.testing.assert_allclose(trace.force_n[late], expected[late], rtol=1e-4, atol=1e-4)


def test_the_paper_does_not_differentiate_across_a_gap() -> None:
    sample = made_up(duration_s=4.0)
    trace = replay(sample, arrivals(sample.time_s, DelayedLink(0.3)), METHODS["paper"](None))
    start = sample.segments()[1].start
    assert trace.answered[2:start].all()
    np.testing.assert_array_equal(trace.answered[start : start + 3], [False, False, True])


@pytest.mark.parametrize("name", ["mbk_bias", "forefeel"])
def test_on_a_contact_that_it_can_describe_a_model_beats_the_hold(name: str) -> None:
    sample = made_up(duration_s=8.0)
    assert sample.force_n is not None
    late = arrivals(sample.time_s, DelayedLink(0.3))
    trace = replay(sample, late, METHODS[name](None))
    rows = (sample.time_s > 5.0) & trace.answered
    assert np.mean(rows[sample.time_s > 5.0]) > 0.95
    held = hold_oracle(sample.time_s, sample.force_n, 0.3)
    error, hold_error = trace.force_n - sample.force_n, held - sample.force_n
    assert np.std(error[rows]) < 0.4 * np.std(hold_error[rows])


@pytest.mark.parametrize("name", METHODS)
def test_motion_out_of_all_proportion_raises_nothing(name: str) -> None:
    sample = made_up(duration_s=2.0)
    assert sample.force_n is not None
    position_m = sample.position_m.copy()
    position_m[50:] *= 1e200
    wild = recording(sample.time_s, position_m, sample.force_n * 1e200)
    replay(wild, arrivals(sample.time_s, DelayedLink(0.05)), METHODS[name](None))


def test_late_forces_meet_the_motion_of_their_own_stamp() -> None:
    pairs = Pairs[str]()
    pairs.remember(1.0, "one")
    pairs.remember(2.0, "two")
    for stamp_s in 2.0, 1.5, 1.0:
        pairs.arrived(stamp_s, 10 * stamp_s)
    assert pairs.take() == [(1.0, "one", 10.0), (2.0, "two", 20.0)]
    assert pairs.take() == []
    pairs.remember(1.5 + LONGEST_LATENESS_S, "late")
    for stamp_s in 1.0, 2.0:
        pairs.arrived(stamp_s, 0.0)
    assert pairs.take() == [(2.0, "two", 0.0)]
