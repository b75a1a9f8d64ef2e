import numpy as np
import pytest

from forefeel.diagnosis.evaluation.methods import MethodTrace
from forefeel.diagnosis.evaluation.score import RUNAWAY, Score, completed, score, scored_stamps
from tests.unit.evaluation_samples import Floats

N = 1000
TIME_S: Floats = np.arange(N, dtype=np.float64) * 0.01
RNG = np.random.default_rng(2)
FORCE_N = RNG.normal(0, 1, N)


def trace(force_n: Floats, half_width_n: float | None = None, leading: str = "") -> MethodTrace:
    band = np.nan if half_width_n is None else half_width_n
    answered = np.isfinite(force_n)
    return MethodTrace(answered, force_n, force_n - band, force_n + band, (leading,) * len(force_n))


ZOH = trace(FORCE_N + 0.5)
ROWS = scored_stamps(TIME_S, 0.3, ZOH)


def scored(said: MethodTrace) -> Score:
    return score(TIME_S, FORCE_N, said, ZOH, ROWS)


def test_scored_from_three_seconds_and_the_delay_on() -> None:
    assert TIME_S[ROWS][0] == pytest.approx(3.30)
    assert ROWS.sum() == N - 330
    shifted = scored_stamps(TIME_S + 1000.0, 0.3, ZOH)
    assert abs(int(shifted.sum()) - int(ROWS.sum())) <= 1  # rounding of the stamps


def test_before_a_force_arrives_nothing_is_scored() -> None:
    zoh_n = FORCE_N.copy()
    zoh_n[:500] = np.nan
    assert np.flatnonzero(scored_stamps(TIME_S, 0.3, trace(zoh_n)))[0] == 500


def test_sizes_are_numpys() -> None:
    error = RNG.normal(0, 0.2, N)
    size = scored(trace(FORCE_N + error)).size
    inside = error[330:]
    assert size.rms_n == pytest.approx(np.sqrt(np.mean(inside**2)), rel=1e-12)
    assert size.p95_n == pytest.approx(np.percentile(np.abs(inside), 95), rel=1e-12)
    assert size.max_n == pytest.approx(np.max(np.abs(inside)), rel=1e-12)


def test_where_nothing_is_said_zoh_counts() -> None:
    said_n = FORCE_N.copy()
    said_n[::2] = np.nan
    expected = np.where(np.arange(N) % 2 == 0, FORCE_N + 0.5, FORCE_N)
    np.testing.assert_array_equal(completed(trace(said_n), ZOH), expected)
    assert scored(trace(said_n)).size.rms_n == pytest.approx(0.5 * np.sqrt(0.5), rel=1e-3)


@pytest.mark.parametrize("wild", [np.nan, np.inf, -1.01 * RUNAWAY * np.abs(FORCE_N).max(), 1e300])
def test_a_method_that_ran_away_has_no_size_but_a_time(wild: float) -> None:
    said_n = FORCE_N.copy()
    said_n[600:] = wild
    said = MethodTrace(np.ones(N, dtype=np.bool_), said_n, said_n, said_n, ("",) * N)
    found = scored(said)
    assert (found.size.rms_n, found.size.p95_n, found.size.max_n) == (None, None, None)
    assert found.diverged_at_s == pytest.approx(6.0)
    assert found.band.coverage is None


def test_what_ran_away_and_came_back_before_the_score_began_did_not_diverge() -> None:
    said_n = FORCE_N.copy()
    said_n[10] = 1e300
    assert scored(trace(said_n)).diverged_at_s is None
    assert scored(trace(said_n)).size.rms_n == 0.0


def test_band_and_leading_expert_are_counted_where_it_is_scored() -> None:
    error = RNG.normal(0, 1, N)
    said = trace(FORCE_N + error, half_width_n=1.0)
    leading = ("early",) * 600 + ("b",) * 300 + ("",) * 100
    found = scored(MethodTrace(said.answered, said.force_n, said.low_n, said.high_n, leading)).band
    assert found.coverage == pytest.approx(np.mean(np.abs(error[330:]) <= 1.0))
    assert found.width_n == pytest.approx(2.0)
    assert found.leading == "b"
