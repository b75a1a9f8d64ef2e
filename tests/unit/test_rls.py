from collections.abc import Callable
from dataclasses import dataclass
from math import cos, exp, inf, isnan, nan, pi, sin
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


def excited(rng: Random, n: int) -> list[float]:
    return [rng.gauss(0.0, 1.0) for _ in range(n)]


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


def test_a_collinear_motion_does_not_wind_up() -> None:
    rls = RecursiveLeastSquares((1.0, 1.0, 1.0), memory_s=0.5)
    for i in range(20_000):
        s, c = sin(i * DT), cos(i * DT)
        rls.update((-s, c, s), -0.01 * s + 0.1 * c + s, DT)
    assert scaled_trace(rls) < 300.0 / 0.98
    m, b, k = rls.theta
    assert (k - m, b) == pytest.approx((0.99, 0.1), abs=1e-3)


def test_a_sample_without_information_changes_nothing() -> None:
    rng, rls = Random(5), RecursiveLeastSquares((1.0, 1.0), memory_s=1.0)
    for _ in range(3000):
        rls.update(excited(rng, 2), rng.gauss(0.0, 0.1), DT)
    before = rls.theta, rls.covariance, rls.updates
    rls.update((0.01, 0.01), 0.05, DT)
    assert (rls.theta, rls.covariance, rls.updates) == before
    rls.update((1.0, 1.0), 0.05, DT)
    assert rls.updates == before[2] + 1


@pytest.mark.parametrize(
    ("phi", "y", "dt"),
    [
        ((nan, 1.0), 1.0, DT),
        ((inf, 1.0), 1.0, DT),
        ((0.0, -inf), 1.0, DT),
        ((1.0, 1.0), nan, DT),
        ((1.0, 1.0), inf, DT),
        ((1.0, 1.0), 1.0, nan),
        ((1.0, 1.0), 1.0, inf),
        ((1.0, 1.0), 1.0, -DT),
        ((1e200, 1.0), 1.0, DT),
        ((1.0, 1.0), 1e200, DT),
    ],
)
def test_numbers_that_are_no_measurement_are_left_out(phi: tuple[float, float], y: float, dt: float) -> None:
    rls = RecursiveLeastSquares((1.0, 1.0), memory_s=1.0)
    rls.update((0.3, 0.7), 1.0, DT)
    before = (rls.theta, rls.covariance, rls.updates)
    rls.update(phi, y, dt)
    assert (rls.theta, rls.covariance, rls.updates) == before


def test_a_bound_keeps_the_fit_where_the_motion_can_not_tell_parameters_apart() -> None:
    bounds = ((0.0, inf),) * 3
    rls = RecursiveLeastSquares((1.0, 1.0, 1.0), memory_s=2.0, bounds=bounds)
    for i in range(10_000):
        s, c = sin(i * DT), cos(i * DT)
        rls.update((-s, c, s), -0.01 * s + 0.1 * c + s, DT)
    assert rls.theta == pytest.approx((-0.495, 0.1, 0.495), abs=1e-3)
    assert rls.parameters == pytest.approx((0.0, 0.1, 0.99), abs=1e-3)
    assert min(rls.parameters) >= 0.0


def test_the_bounded_parameters_are_the_constrained_least_squares() -> None:
    rng, rls = Random(8), RecursiveLeastSquares((1.0, 1.0), inf, bounds=((0.0, 9.0), (-9.0, 9.0)))
    rows = [(p := rng.gauss(0.0, 1.0), 0.9 * p + rng.gauss(0.0, 0.3)) for _ in range(500)]
    forces = [-0.5 * p + 1.0 * q + rng.gauss(0.0, 0.01) for p, q in rows]
    for phi, y in zip(rows, forces, strict=True):
        rls.update(phi, y, DT)
    q = np.array(rows)[:, 1]
    assert rls.parameters[0] == 0.0
    assert rls.parameters[1] == pytest.approx(float(q @ np.array(forces) / (q @ q + 0.01)), rel=1e-9)


@dataclass(frozen=True)
class Sample:
    """One filtered sample of a contact, and the filtered force without noise."""

    segment: str
    phi: tuple[float, float, float, float]
    force_n: float
    true_n: float


NOISE_N = 0.010


def multi_sine(t: float) -> float:
    tones = ((0.004, 0.37), (0.002, 0.91), (0.001, 2.3))
    return sum(a * sin(2.0 * pi * f * t) for a, f in tones)


def hold_scenario() -> list[Sample]:
    """Excitation, hold, motion, stiffer tissue under a pure sine, hold, motion; 1 um encoder, 10 mN noise."""
    parts: list[tuple[str, float, float, Callable[[float], float]]] = [
        ("excitation", 10.0, 80.0, multi_sine),
        ("hold 1", 10.0, 80.0, lambda t: 0.0),
        ("after hold 1", 1.0, 80.0, multi_sine),
        ("sine", 10.0, 160.0, lambda t: 0.004 * sin(pi * t)),
        ("hold 2", 10.0, 160.0, lambda t: 0.0),
        ("after hold 2", 1.0, 160.0, multi_sine),
    ]
    rng, samples = Random(9), []
    motion, force, truth = StateFilter(15.0), StateFilter(15.0), StateFilter(15.0)
    for segment, duration_s, k, position in parts:
        course = from_rest_to_rest(position, duration_s)
        for i in range(round(duration_s / DT)):
            x, v, a = motion_at(course, i * DT)
            f = 0.05 * a + 0.6 * v + k * x + 0.12
            x_f, v_f, a_f = motion.step(round(x * 1e6) * 1e-6, DT)
            y, _, _ = force.step(f + rng.gauss(0.0, NOISE_N), DT)
            true_n, _, _ = truth.step(f, DT)
            samples.append(Sample(segment, (a_f, v_f, x_f, 1.0), y, true_n))
    return samples


def from_rest_to_rest(position: Callable[[float], float], duration_s: float) -> Callable[[float], float]:
    """`position` faded in and out within 0.4 s around 2 mm, two derivatives continuous."""

    def fade(t: float) -> float:
        u = min(max(t / 0.4, 0.0), 1.0)
        return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)

    return lambda t: 0.002 + position(t) * fade(t) * fade(duration_s - t)


def motion_at(position: Callable[[float], float], t: float) -> tuple[float, float, float]:
    h = 1e-4
    before, here, after = position(t - h), position(t), position(t + h)
    return here, (after - before) / (2.0 * h), (after - 2.0 * here + before) / h**2


def worst_errors(estimator: RecursiveLeastSquares | PaperRls, samples: list[Sample]) -> dict[str, float]:
    """Largest a priori force error per segment; NaN counts as infinite."""
    worst: dict[str, float] = {}
    for sample in samples:
        predicted = sum(p * t for p, t in zip(sample.phi, estimator.theta, strict=True))
        error = abs(predicted - sample.true_n)
        worst[sample.segment] = max(worst.get(sample.segment, 0.0), inf if isnan(error) else error)
        if isinstance(estimator, PaperRls):
            estimator.update(sample.phi, sample.force_n)
        else:
            estimator.update(sample.phi, sample.force_n, DT)
    return worst


def test_after_a_hold_the_force_error_stays_near_the_noise_where_the_paper_diverges() -> None:
    samples = hold_scenario()
    rls = RecursiveLeastSquares((0.1, 0.015, 0.004, 1.0), memory_s=2.0)
    ours, paper = worst_errors(rls, samples), worst_errors(PaperRls(4, 0.96), samples)
    for segment in ("hold 1", "after hold 1", "hold 2", "after hold 2"):
        assert ours[segment] < 2.0 * NOISE_N, segment
    assert min(paper["after hold 1"], paper["after hold 2"]) > 1.0
    assert scaled_trace(rls) < 400.0 / 0.98


def test_the_same_samples_give_the_same_floats() -> None:
    def run() -> tuple[object, ...]:
        rng, rls = Random(10), RecursiveLeastSquares((1.0, 1.0, 1.0), memory_s=0.3)
        for _ in range(2000):
            rls.update(excited(rng, 3), rng.gauss(0.0, 1.0), rng.uniform(0.0, 0.003))
        return rls.theta, rls.covariance, rls.parameters

    assert run() == run()
