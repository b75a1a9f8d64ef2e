from math import inf

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from forefeel.diagnosis.evaluation.rls import RecursiveLeastSquares

number = st.floats(-10.0, 10.0).map(lambda value: round(value, 6))
step_s = st.floats(1e-5, 5.0)
scale = st.floats(1e-3, 1e3)


Problem = tuple[list[float], list[tuple[list[float], float, float]]]


@st.composite
def problems(draw: st.DrawFn) -> Problem:
    """Scales, and samples (phi in units of the scales, y, dt)."""
    n = draw(st.integers(1, 5))
    scales = draw(st.lists(scale, min_size=n, max_size=n))
    sample = st.tuples(st.lists(number, min_size=n, max_size=n), number, step_s)
    return scales, draw(st.lists(sample, min_size=1, max_size=40))


def fed(problem: Problem, memory_s: float) -> RecursiveLeastSquares:
    scales, samples = problem
    rls = RecursiveLeastSquares(scales, memory_s, [(-0.5 / s, 1.0 / s) for s in scales])
    for phi, y, dt in samples:
        rls.update([p * s for p, s in zip(phi, scales, strict=True)], y, dt)
    return rls


def scaled_covariance(rls: RecursiveLeastSquares) -> NDArray[np.float64]:
    return np.asarray(np.array(rls.covariance) * np.outer(rls.scales, rls.scales))


@given(problems())
def test_without_forgetting_it_is_batch_least_squares_with_the_prior_as_ridge(problem: Problem) -> None:
    scales, samples = problem
    rls = fed(problem, inf)
    phi = np.array([row for row, _, _ in samples])
    normal = phi.T @ phi + np.eye(len(scales)) / 100.0
    expected = np.linalg.solve(normal, phi.T @ np.array([y for _, y, _ in samples]))
    np.testing.assert_allclose(np.array(rls.theta) * scales, expected, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(scaled_covariance(rls), np.linalg.inv(normal), rtol=1e-6, atol=1e-9)


@given(problems(), st.floats(1e-3, 10.0))
def test_the_covariance_stays_symmetric_positive_and_below_the_prior(
    problem: Problem, memory_s: float
) -> None:
    rls = fed(problem, memory_s)
    p = scaled_covariance(rls)
    assert np.array_equal(np.array(rls.covariance), np.array(rls.covariance).T)
    eigenvalues = np.linalg.eigvalsh(p)
    assert eigenvalues[0] > 0.0
    assert eigenvalues[-1] <= 100.0 / 0.98 * (1.0 + 1e-9)


@given(problems(), st.floats(0.01, 10.0))
def test_reported_parameters_obey_their_bounds(problem: Problem, memory_s: float) -> None:
    rls = fed(problem, memory_s)
    for value, s in zip(rls.parameters, problem[0], strict=True):
        assert -0.5 / s <= value <= 1.0 / s


@given(problems())
def test_scales_are_units_only(problem: Problem) -> None:
    scales, samples = problem
    in_units, unscaled = fed(problem, 1.0), fed(([1.0] * len(scales), samples), 1.0)
    np.testing.assert_allclose(np.array(in_units.theta) * scales, unscaled.theta, rtol=1e-6, atol=1e-6)


@given(problems(), st.lists(st.floats(), min_size=5, max_size=5), st.floats(), st.floats())
def test_no_float_can_break_it(problem: Problem, phi: list[float], y: float, dt: float) -> None:
    rls = fed(problem, 1.0)
    rls.update(phi[: len(rls.scales)], y, dt)
    rls.update(list(rls.scales), 1.0, 0.001)
    assert np.isfinite(rls.parameters).all()
    assert np.isfinite(rls.covariance).all()
