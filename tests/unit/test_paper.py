"""The paper's algorithm against batch least squares, its oracle."""

import numpy as np
import pytest

from forefeel.common.estimation.paper import PaperRls, SisoRegressor


def _weighted_batch(rows: np.ndarray, y: np.ndarray, lam: float, delta: float) -> np.ndarray:
    """argmin sum lam^(N-k) (y - phi' theta)^2 + lam^N delta |theta|^2, what (8) to (12) solve exactly."""
    n = len(y)
    weight = lam ** np.arange(n - 1, -1, -1.0)
    information = (rows.T * weight) @ rows + lam**n * delta * np.eye(rows.shape[1])
    return np.asarray(np.linalg.solve(information, (rows.T * weight) @ y))


@pytest.mark.parametrize("lam", [1.0, 0.99, 0.95])
@pytest.mark.parametrize("symmetrise", [False, True])
def test_equals_weighted_batch_least_squares(lam: float, symmetrise: bool) -> None:
    rng = np.random.default_rng(1)
    rows, noise = rng.normal(size=(200, 3)), 0.1 * rng.normal(size=200)
    y = rows @ np.array([0.01, 0.1, 1.0]) + noise
    rls = PaperRls(3, lam, delta=1e-3, symmetrise=symmetrise)
    for phi, value in zip(rows, y, strict=True):
        rls.update(phi, value)
    np.testing.assert_allclose(rls.theta, _weighted_batch(rows, y, lam, 1e-3), rtol=1e-8)


@pytest.mark.parametrize(("na", "nb"), [(1, 1), (2, 2), (3, 2)])
def test_identifies_a_siso_system_of_any_order(na: int, nb: int) -> None:
    """y(k) + a1 y(k-1) + ... = b1 u(k-1) + ..., equation (3), recovered to rounding."""
    rng = np.random.default_rng(2)
    a = np.array([-1.2, 0.5, -0.05])[:na] if na > 1 else np.array([-0.8])
    b = np.array([0.7, -0.3])[:nb]
    regressor, rls = SisoRegressor(na, nb), PaperRls(na + nb, 1.0, delta=1e-9)
    truth = np.concatenate([a, b])
    for u in rng.normal(size=400):
        phi = regressor.phi()
        y = float(phi @ truth)
        rls.update(phi, y)
        regressor.push(y, u)
    np.testing.assert_allclose(rls.theta, truth, atol=1e-6)


def test_the_regressor_holds_the_newest_values_first() -> None:
    regressor = SisoRegressor(2, 3)
    for y, u in [(1.0, 10.0), (2.0, 20.0), (3.0, 30.0)]:
        regressor.push(y, u)
    assert regressor.phi().tolist() == [-3.0, -2.0, 30.0, 20.0, 10.0]
