"""The paper's algorithm against batch least squares, and its simulation against closed forms."""

import numpy as np
import pytest

from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.evaluation.methods import PaperRls
from studies import paper
from studies.paper import DELAY_S, THETA, learn, rms, sines


@pytest.mark.parametrize("lam", [1.0, 0.99, 0.95])
@pytest.mark.parametrize("symmetrise", [False, True])
def test_paper_rls_equals_weighted_batch_least_squares(lam: float, symmetrise: bool) -> None:
    """(8) to (12) minimise sum lam^(N-k) (y - phi' theta)^2 + lam^N delta |theta|^2."""
    rng = np.random.default_rng(1)
    rows, noise = rng.normal(size=(200, 3)), 0.1 * rng.normal(size=200)
    y = rows @ THETA + noise
    rls = PaperRls(3, lam, delta=1e-3, symmetrise=symmetrise)
    for phi, value in zip(rows, y, strict=True):
        rls.update(phi, value)
    weight = lam ** np.arange(199, -1, -1.0)
    information = (rows.T * weight) @ rows + lam**200 * 1e-3 * np.eye(3)
    np.testing.assert_allclose(rls.theta, np.linalg.solve(information, (rows.T * weight) @ y), rtol=1e-8)


@pytest.mark.parametrize("delay_s", [0.0, DELAY_S])
def test_figures_4_and_5_coincide_when_paired_by_stamps(delay_s: float) -> None:
    time_s, phi = sines(100.0, 3 * paper.PERIOD_S)
    force_n, late = phi @ THETA, time_s >= paper.PERIOD_S
    arrived_n = paper.held(time_s, force_n, delay_s) if delay_s else force_n
    predicted_n, theta = learn(time_s, phi, force_n, delay_s)
    newest_n, _ = learn(time_s, phi, force_n, delay_s, newest_motion=True)
    np.testing.assert_allclose(theta, [-0.495, 0.1, 0.495], atol=1e-6)
    assert rms((predicted_n - force_n)[late]) < 1e-9
    assert paper.lead_s(time_s[late], predicted_n[late], arrived_n[late]) == pytest.approx(delay_s, abs=1e-6)
    if delay_s:
        assert paper.lead_s(time_s[late], newest_n[late], arrived_n[late]) == pytest.approx(0.0, abs=1e-6)


def test_wrong_pairing_learns_the_delayed_force() -> None:
    found = paper.pairing_rms()
    hold_n = np.sqrt(2.0) * paper.amplitude_n(THETA, 1.0) * np.sin(0.5 * DELAY_S)
    assert found["hold"] == pytest.approx(hold_n, rel=1e-3)
    assert found["newest"] == pytest.approx(hold_n, rel=1e-3)
    assert found["paper"] < 1e-9
    assert found["product"] < 1e-4


def test_sine_leaves_mass_and_stiffness_unidentified() -> None:
    """Without noise, from theta = 0 and P = I / delta, (8) to (12) tend to the least norm."""
    least_norm, product, says = paper.identified((1.0, 1.0))
    rows = sines(100.0, 20.0)[1]
    np.testing.assert_allclose(least_norm, np.linalg.lstsq(rows, rows @ THETA, rcond=None)[0], atol=1e-6)
    predicted = [paper.amplitude_n(least_norm, w) for w in (2.0, 5.0, 10.0)]
    assert predicted == pytest.approx([2.483, 12.88, 50.01], rel=1e-3)
    assert product[2] - product[0] == pytest.approx(0.99, abs=1e-3)
    assert product[0] >= 0.0
    assert says == ("m and k only as k - 1.00 m",)
    two_paper, two_product, says = paper.identified((1.0, 1.0), (0.3, 4.0))
    np.testing.assert_allclose(two_paper, THETA, atol=1e-9)
    np.testing.assert_allclose(two_product, THETA, atol=1e-5)
    assert says == ()


def test_windup_overflows_when_lambda_to_the_minus_k_does() -> None:
    found = paper.windup(0.95)
    assert found.overflow_s == pytest.approx(13.5684, rel=1e-3)  # ln(1.797e308 * 1e-6) / -ln(0.95) at 1 kHz
    assert paper.expected_overflow_s(0.95) == pytest.approx(13.5684, rel=1e-4)
    per_sample = (np.log(found.growth[-1]) - np.log(found.growth[-101])) / 2000
    assert per_sample == pytest.approx(-np.log(0.95), rel=1e-3)
    assert paper.windup(0.95, seed=0).largest.max() > 1e4  # by how much is the machine's rounding


def test_more_samples_harm_the_paper_and_help_the_product() -> None:
    fast, slow = paper.memory_rms(100.0, 2), paper.memory_rms(10.0, 2)
    assert np.median(fast["paper"]) > 10 * np.median(slow["paper"])
    assert np.median(fast["m known"]) > np.median(slow["m known"])
    assert np.median(fast["product"]) < np.median(slow["product"]) < 0.002


@pytest.mark.parametrize("what", ["bias", "friction"])
def test_unmodelled_force_leaves_what_the_model_lacks(what: str) -> None:
    found = paper.unmodelled_rms(what, 0.010)
    assert found["lambda = 1"] == pytest.approx(found["closed form"], rel=0.03)
    assert found["paper"] > 0.9 * found["closed form"]
    assert found["product"] < 0.1 * found["closed form"]


def test_since_the_paper_each_method_is_measured_by_the_hold() -> None:
    time_s = 0.02 * np.arange(600.0)
    x = 0.01 * np.sin(2.1 * time_s) + 0.004 * np.sin(5.3 * time_s)
    force_n = 40.0 * x + 0.5 * np.gradient(x, time_s) + 2.0
    run = paper.compared("kv", Recording("kv", time_s, x, force_n, "made up"), 1.1 * force_n)
    head, row, mean = paper.since([run]).rows
    ratios = dict(zip(head[1:], map(float, row[1:]), strict=True))
    assert list(ratios) == ["paper", "Kelvin-Voigt", "Hunt-Crossley", "model-free", "product"]
    assert max(ratios[name] for name in paper.PUBLISHED_SINCE.values()) < 0.1
    assert ratios["product"] == pytest.approx(run.of_hold("product"), rel=1e-2)
    assert mean[1:] == row[1:]


def test_no_prediction_knows_the_future() -> None:
    """Forces after t - delay and motion after t, exchanged for each other, change nothing up to t."""
    time_s = 0.02 * np.arange(450.0)
    x = 0.01 * np.sin(2.1 * time_s) + 0.004 * np.sin(5.3 * time_s)
    force_n = 40.0 * x + 0.2 + 0.002 * np.random.default_rng(3).normal(size=len(x))
    late, after = time_s > time_s[300] - DELAY_S, time_s > time_s[300]
    forces, positions = force_n.copy(), x.copy()
    forces[late], positions[after] = forces[late][::-1], positions[after][::-1]
    nothing = np.full(len(x), np.nan)
    before = paper.compared("a", Recording("a", time_s, x, force_n, "made up"), nothing)
    altered = paper.compared("b", Recording("b", time_s, positions, forces, "made up"), nothing)
    for name in ("hold", "paper", "newest", "tared"):
        np.testing.assert_array_equal(before.predicted_n[name][:301], altered.predicted_n[name][:301])
        assert np.isfinite(before.predicted_n[name][300])
