from math import cos, exp, inf, nan, pi, sin
from random import Random

import numpy as np
import pytest

from forefeel.common.estimation.state_filter import StateFilter
from forefeel.diagnosis.evaluation.methods import PaperRls
from forefeel.diagnosis.evaluation.rls import RecursiveLeastSquares

DT = 0.001


def scaled_trace(rls: RecursiveLeastSquares) -> float:
    p = rls.covariance
    return sum(p[i][i] * scale**2 for i, scale in enumerate(rls.scales))


def test_one_sample_is_equations_9_to_12() -> None:
    rng, memory_s = Random(3), 5.0
    rls = RecursiveLeastSquares((1.0, 2.0, 0.5), memory_s)
    p, theta, lam = np.diag([100.0, 25.0, 400.0]), np.zeros(3), exp(-DT / memory_s)
    for _ in range(20):
        phi, y = np.array(excited(rng, 3)), rng.gauss(0.0, 1.0)
        gain = p @ phi / (lam + phi @ p @ phi)
        e = y - phi @ theta
        theta = theta + gain * e
        p = (np.eye(3) - np.outer(gain, phi)) @ p / lam
        rls.update(phi.tolist(), y, DT)
    assert rls.theta == pytest.approx(theta, rel=1e-9)
    assert np.allclose(rls.covariance, p, rtol=1e-9, atol=0.0)


def test_forgetting_returns_to_the_information_of_the_prior() -> None:
    rng, memory_s, prior = Random(4), 0.2, np.diag([100.0, 25.0])
    rls = RecursiveLeastSquares((1.0, 2.0), memory_s)
    lam, information = exp(-DT / memory_s), np.linalg.inv(prior)
    for _ in range(3000):
        phi = np.array([rng.gauss(0.0, 1.0), 0.0])
        before = rls.updates
        rls.update(phi.tolist(), rng.gauss(0.0, 0.1), DT)
        if rls.updates > before:
            information = lam * information + (1.0 - lam) * np.linalg.inv(prior) + np.outer(phi, phi)
    assert np.allclose(rls.covariance, np.linalg.inv(information), rtol=0.03, atol=1e-12)


def test_a_sample_without_information_changes_nothing() -> None:
    rng, rls = Random(5), RecursiveLeastSquares((1.0, 1.0), memory_s=1.0)
    for _ in range(3000):
        rls.update(excited(rng, 2), rng.gauss(0.0, 0.1), DT)
    before = rls.theta, rls.covariance, rls.updates
    rls.update((0.01, 0.01), 0.05, DT)
    for wrong in nan, inf, -inf, 1e200:  # nor one that is no measurement
        rls.update((wrong, 1.0), 1.0, DT)
        rls.update((1.0, 1.0), wrong, DT)
    for dt in nan, inf, -DT:
        rls.update((1.0, 1.0), 1.0, dt)
    assert (rls.theta, rls.covariance, rls.updates) == before
    rls.update((1.0, 1.0), 0.05, DT)
    assert rls.updates == before[2] + 1


def test_the_bounded_parameters_are_the_constrained_least_squares() -> None:
    rng, rls = Random(8), RecursiveLeastSquares((1.0, 1.0), inf, bounds=((0.0, 9.0), (-9.0, 9.0)))
    rows = [(p := rng.gauss(0.0, 1.0), 0.9 * p + rng.gauss(0.0, 0.3)) for _ in range(500)]
    forces = [-0.5 * p + 1.0 * q + rng.gauss(0.0, 0.01) for p, q in rows]
    for phi, y in zip(rows, forces, strict=True):
        rls.update(phi, y, DT)
    q = np.array(rows)[:, 1]
    assert rls.parameters[0] == 0.0
    assert rls.parameters[1] == pytest.approx(float(q @ np.array(forces) / (q @ q + 0.01)), rel=1e-9)


NOISE_N = 0.010


def test_after_a_hold_the_force_error_stays_near_the_noise_where_the_paper_diverges() -> None:
    """5 s of motion, 10 s of rest, 1 s of motion again: 1 um encoder, 10 mN noise."""
    rng, noise_n, t = np.random.default_rng(9), 0.010, np.arange(0.0, 16.0, DT)
    swing = np.clip(np.minimum(5.0 - t, t), 0.0, 0.4) / 0.4 + np.clip((t - 15.0) / 0.4, 0.0, 1.0)
    x = 0.002 + swing**3 * (10.0 - 15.0 * swing + 6.0 * swing**2) * 0.004 * np.sin(2.0 * pi * 0.9 * t)
    v = np.gradient(x, DT)
    force_n = 0.05 * np.gradient(v, DT) + 0.6 * v + 80.0 * x + 0.12
    measured = np.column_stack([np.round(x, 6), force_n, force_n + rng.normal(0.0, noise_n, len(t))])
    motion, truth, sensor = StateFilter(15.0), StateFilter(15.0), StateFilter(15.0)
    ours, paper, errors_n = RecursiveLeastSquares((0.1, 0.015, 0.004, 1.0), 2.0), PaperRls(4, 0.96), []
    for encoder_m, true_n, noisy_n in measured.tolist():
        x_f, v_f, a_f = motion.step(encoder_m, DT)
        phi, y = (a_f, v_f, x_f, 1.0), sensor.step(noisy_n, DT)[0]
        filtered_n = truth.step(true_n, DT)[0]
        errors_n.append([abs(np.dot(phi, each.theta) - filtered_n) for each in (ours, paper)])
        ours.update(phi, y, DT)
        paper.update(phi, y)
    ours_n, paper_n = np.max(np.array(errors_n)[t > 6.0], axis=0)
    assert ours_n < 2.0 * noise_n
    assert not paper_n <= 1.0  # nor is a NaN
    assert scaled_trace(ours) < 400.0 / 0.98


@pytest.mark.parametrize("memory_s", [0.5, 2.0])
def test_a_bound_keeps_the_fit_where_a_collinear_motion_can_not_tell_parameters_apart(
    memory_s: float,
) -> None:
    """A sine, which leaves m and k - m alone apart from each other; it does not wind up."""
    rls = RecursiveLeastSquares((1.0, 1.0, 1.0), memory_s=memory_s, bounds=((0.0, inf),) * 3)
    for i in range(20_000):
        s, c = sin(i * DT), cos(i * DT)
        rls.update((-s, c, s), -0.01 * s + 0.1 * c + s, DT)
    assert rls.theta == pytest.approx((-0.495, 0.1, 0.495), abs=1e-3)
    assert rls.parameters == pytest.approx((0.0, 0.1, 0.99), abs=1e-3)
    assert min(rls.parameters) >= 0.0
    assert scaled_trace(rls) < 300.0 / 0.98


def excited(rng: Random, n: int) -> list[float]:
    return [rng.gauss(0.0, 1.0) for _ in range(n)]
