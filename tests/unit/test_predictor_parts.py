"""Least squares, blend, band and the notice of a change, each against an oracle of its own."""

import numpy as np
import pytest
from numpy.typing import NDArray

from forefeel.common.estimation import band as bands
from forefeel.common.estimation import blend as blends
from forefeel.common.estimation import change_detection, experts
from forefeel.common.estimation.bank import (
    COUNT,
    FIRST_DIFFERENCE,
    FIRST_NONLINEAR,
    FIRST_RELAXATION,
    FIRST_STOP,
    STOPS,
)
from forefeel.common.kernels.record import Array, Record
from tests.unit.inner_kernels import call, count, number

H_S = 5e-3


def rows_and_forces(count: int = 400) -> tuple[Array, Array, Array]:
    """Rows u of usual sizes over six decades, f(t) - f(s) and f - f0."""
    rng = np.random.default_rng(1)
    rows = rng.standard_normal((count, experts.ROW)) * 10.0 ** rng.uniform(-3, 3, experts.ROW)
    return rows, rng.standard_normal(count), 1.0 + rng.standard_normal(count)


def learned(rows: Array, steps_n: Array, forces_n: Array) -> Record:
    learning = Record(experts.Learning)
    experts.begin(learning.values)
    for n in range(len(rows)):
        call("learn_experts", learning, rows[n], n * H_S, float(steps_n[n]), float(forces_n[n]), H_S)
    call("solve", learning)
    return learning


class TestExperts:
    """R, r and theta by numpy and the formulas of the module's text."""

    REGRESSORS = (
        ("autoregression", range(experts.PAST, experts.STEP), 0.05, 0),
        ("friction", range(experts.PAST, experts.ROW), 0.05, 0),
        ("absolute", range(experts.STEP), 0.03, 0),
        ("plain", range(COUNT), 0.05, 1),
        ("odd", range(1, FIRST_RELAXATION), 0.05, 1),
    )

    @pytest.mark.parametrize(("name", "columns", "rho_s", "level"), REGRESSORS)
    def test_theta_is_the_regularised_least_squares(
        self, name: str, columns: range, rho_s: float, level: int
    ) -> None:
        rows, *targets = rows_and_forces()
        weights = H_S * np.exp(-np.arange(len(rows))[::-1] * H_S / 120.0)
        z = rows[:, columns]
        information, moments = (z * weights[:, None]).T @ z, z.T @ (weights * targets[level])
        phi_shares = np.ones(COUNT)
        phi_shares[0], phi_shares[2:4], phi_shares[FIRST_DIFFERENCE:FIRST_NONLINEAR] = 1e-3, 0.1, 0.1
        phi_shares[FIRST_NONLINEAR:] = 3.0
        shares = np.concatenate((phi_shares, phi_shares[1:], np.ones(7), phi_shares[1:FIRST_RELAXATION]))
        usual = np.diag(information) / weights.sum()
        stops = [k for k, column in enumerate(columns) if FIRST_STOP <= column < FIRST_RELAXATION]
        usual[stops] = np.maximum(usual[stops], 0.3)
        ridge = rho_s * shares[list(columns)] * usual
        expected = np.linalg.solve(information + np.diag(ridge), moments)
        theta = learned(rows, *targets).values["theta"][experts.NAMES.index(name)][columns]
        np.testing.assert_allclose(z @ theta, z @ expected, atol=1e-6)

    def test_each_expert_starts_where_it_says_and_goes_no_further_than_its_reach(self) -> None:
        rows, steps_n, forces_n = rows_and_forces()
        theta = learned(rows, steps_n, forces_n).values["theta"]
        said_n = np.zeros(len(experts.NAMES))
        call("predict_experts", said_n, theta, rows[7], 5.0, 2.0, 1e9, 1e9)
        changes_n = theta @ rows[7]
        odd_n = theta[experts.ODD][1:FIRST_RELAXATION] @ rows[7][experts.STEP :]
        bases_n = np.where(np.arange(5) == experts.PLAIN, 2.0, 5.0)
        np.testing.assert_allclose(said_n, bases_n + np.where(np.arange(5) == experts.ODD, odd_n, changes_n))
        call("predict_experts", said_n, 1e9 * theta, rows[7], 5.0, 2.0, 0.1, 0.2)
        np.testing.assert_allclose(np.abs(said_n - bases_n), [0.13, 0.13, 0.13, 0.26, 0.4])

    def test_a_stop_that_has_another_radius_is_forgotten_and_the_rest_is_not(self) -> None:
        rows, steps_n, forces_n = rows_and_forces()
        radii_m = np.zeros(STOPS)
        radii_m[2] = 1e-3
        renewed, rest = learned(rows, steps_n, forces_n), rows.copy()
        call("renew_stops", renewed, radii_m)
        call("solve", renewed)
        call("clear_stop", rest, len(rest), 2)
        expected = learned(rest, steps_n, forces_n).values["theta"]
        np.testing.assert_allclose(renewed.values["theta"], expected, rtol=1e-6, atol=1e-12)

    def test_a_kick_leaves_the_weight_of_a_fifth_of_a_second(self) -> None:
        learning = learned(*rows_and_forces())
        before = np.array(learning.values["information"])
        call("discount_experts", learning)
        assert learning.values["weight_s"] == pytest.approx(0.2)
        shares = learning.values["information"][0, 0] / before[0, 0]
        assert shares == pytest.approx(0.2 / 2.0, rel=0.02)


def test_weights_are_the_fourth_power_of_the_losses_seen() -> None:
    rng = np.random.default_rng(0)
    blend = Record(blends.Blend)
    blends.begin(blend.values, taught=False)
    members, h, zoh_n, range_n = blends.MEMBERS, 0.019, 0.5, 3.0
    errors = rng.standard_normal((300, members)) * np.linspace(0.1, 2.0, members)
    errors[:, blends.ZOH] = zoh_n * np.linspace(1.0, 2.0, 300)
    errors[:, 2] = np.nan  # one that says nothing
    for n in range(300):
        call("judge_blend", blend, 1.0 + errors[n], 1.0, np.nan, 1.0, range_n, h)
    squares = np.where(np.isnan(errors), errors[:, :1], errors) ** 2
    zoh2, losses = errors[:, 0] ** 2, squares.copy()
    for n in range(300):
        fading = np.exp(-np.arange(n + 1)[::-1] * h / 8.0)
        cap = (0.8 * (1 + (n + 1) * h / 10.0)) ** 2 * max(zoh2[n], fading @ zoh2[: n + 1] / fading.sum())
        losses[n] = np.minimum(squares[n], cap)
    v, largest = np.ones(members), 2 * zoh_n
    for memory_s, share in ((2.0, 0.7), (8.0, 0.3)):
        fading = np.exp(-np.arange(300)[::-1] * h / memory_s)
        v *= ((fading @ losses) / fading.sum() + (0.003 * largest) ** 2) ** share
    cold = (0.1 * largest) ** 2 / (1 + zoh2.sum() * h / (0.1 * largest**2) + (5.7 / 6.0) ** 2)
    v += cold * (np.arange(members) != blends.FIRST + experts.ODD)
    expected = v**-4
    expected /= expected.sum()
    np.testing.assert_allclose(blend.values["weights"], expected, rtol=1e-9)
    early = np.arange(1, 301) * h < 5.0
    shares = -np.expm1(-h / np.minimum(np.arange(1, 301) * h / 4.0, 2.0))
    left = np.append(np.cumprod(1.0 - shares[:0:-1])[::-1], 1.0)
    reach_n = (shares * left) @ np.maximum(np.abs(errors[:, 0]), range_n * early)
    assert blend.values["reach_n"] == pytest.approx(reach_n, rel=1e-9)
    mean = np.empty(3)
    call("blend_mean", expected, 1.0 + errors[299], mean)
    force_n, variance_n2, leading = mean.tolist()
    speaking = np.where(np.isnan(errors[299]), 0.0, expected) / np.sum(expected[~np.isnan(errors[299])])
    said = np.nan_to_num(1.0 + errors[299])
    assert force_n == pytest.approx(speaking @ said, rel=1e-12)
    assert variance_n2 == pytest.approx(speaking @ (said - force_n) ** 2, rel=1e-9)
    assert leading == np.argmax(speaking)


def test_what_lasts_of_the_contacts_residual_is_its_regression_over_8_s() -> None:
    rng = np.random.default_rng(2)
    blend, h, count, zoh_n = Record(blends.Blend), 0.01, 400, 0.2
    blends.begin(blend.values, taught=False)
    assert blend.values["persistence"] == 1.0
    residual = rng.standard_normal(count) * 0.1
    left = 0.4 * residual + 0.05 * rng.standard_normal(count)
    residual[7] = np.nan  # in a gap of the motion
    members = np.full((count, blends.MEMBERS), zoh_n)
    members[:, blends.CONTACT] = -left
    for n in range(count):
        call("judge_blend", blend, members[n], 0.0, float(residual[n]), 0.0, 1.0, h)
    known = np.isfinite(residual)
    fading, known_n2 = np.exp(-np.arange(known.sum())[::-1] * h / 8.0) * h, (0.1 * zoh_n) ** 2
    r = residual[known]
    expected = (fading @ (r * left[known]) + known_n2) / (fading @ r**2 + known_n2)
    assert blend.values["persistence"] == pytest.approx(expected, rel=1e-9)
    assert expected == pytest.approx(0.4, abs=0.05)


def test_taught_contact_shares_with_the_blend_of_the_others_by_the_newest_errors() -> None:
    rng = np.random.default_rng(1)
    h, count, contact = 0.01, 250, blends.CONTACT
    errors = rng.standard_normal((count, blends.MEMBERS))
    others = rng.standard_normal(count) * np.linspace(3.0, 0.5, count)
    errors[:, -1] = np.nan  # in a gap of the motion
    both = [Record(blends.Blend) for _ in range(2)]
    for blend, is_taught in zip(both, (True, False), strict=True):
        blends.begin(blend.values, taught=is_taught)
        for n in range(count):
            call("judge_blend", blend, errors[n], float(others[n]), np.nan, 0.0, 1.0, h)
    squares = np.stack([others, errors[:, contact], errors[:, blends.ZOH]]) ** 2
    keep = np.exp(-h / (0.125 * h * np.arange(1, count + 1)))
    left = np.append(np.cumprod(keep[:0:-1])[::-1], 1.0)
    v = squares @ ((1.0 - keep) * left) + (0.003 * np.abs(errors[:, blends.ZOH]).max()) ** 2
    shares = v**-4.0 * np.append(1.0, np.full(2, (1 + 100 / (1 + (count * h / 0.3) ** 2)) / 1.5**4))
    shares /= shares.sum()
    weights, alone = (blend.values["weights"] for blend in both)
    np.testing.assert_allclose(weights[contact:], shares[1:], rtol=1e-9)
    of_others = alone[:contact] / alone[:contact].sum()
    np.testing.assert_allclose(weights[:contact], shares[0] * of_others, rtol=1e-9)


class TestBand:
    def covered(self, errors: Array, w: float, late: int = 60) -> NDArray[np.bool_]:
        """Which errors are inside, when each is seen only `late` samples after its band was given."""
        band = Record(bands.Band)
        bands.begin(band.values)
        given: list[tuple[float, float]] = []
        inside = np.zeros(len(errors), dtype=np.bool_)
        for n, error in enumerate(errors.tolist()):
            if n >= late:
                call("learn_band", band, float(errors[n - late]), *given[n - late], w)
            scale_n = number("band_scale_n", number("recent_n", band), 0.0, 0.0, 1.0)
            half_n = scale_n * number("band_factor", band)
            given.append((half_n, scale_n))
            inside[n] = abs(error) <= half_n
        return inside

    @pytest.mark.parametrize("law", ["normal", "student 2", "cauchy", "bursts", "growing"])
    def test_one_in_twenty_misses_whatever_the_law(self, law: str) -> None:
        rng, count = np.random.default_rng(4), 40_000
        errors = {
            "normal": rng.standard_normal(count),
            "student 2": rng.standard_t(2, count),
            "cauchy": rng.standard_cauchy(count),
            "bursts": rng.standard_normal(count) * np.where(np.arange(count) % 3000 < 300, 20.0, 1.0),
            "growing": rng.standard_normal(count) * np.exp(np.arange(count) / 10_000),
        }[law]
        assert np.mean(self.covered(errors, 5e-3)[2000:]) == pytest.approx(0.95, abs=0.01)

    def test_the_early_errors_of_learning_are_not_held_against_it_for_long(self) -> None:
        rng = np.random.default_rng(4)
        errors = rng.standard_normal(4000) * np.where(np.arange(4000) < 300, 50.0, 1.0)
        band = Record(bands.Band)
        bands.begin(band.values)
        half_n = scale_n = 1.0
        for error in errors.tolist():
            call("learn_band", band, error, half_n, scale_n, 5e-3)
            scale_n = number("band_scale_n", number("recent_n", band), 0.0, 0.0, 1.0)
            half_n = scale_n * number("band_factor", band)
        assert half_n == pytest.approx(1.96, rel=0.25)

    def test_the_quantile_is_numpys(self) -> None:
        scores = np.abs(np.random.default_rng(6).standard_t(4, 1000))
        band = Record(bands.Band)
        for score in scores.tolist():
            call("learn_band", band, score, np.inf, 1.0, 1e-6)
        assert number("band_factor", band) == pytest.approx(np.quantile(scores, 0.95), rel=0.05)


class TestChange:
    def kicks(self, errors: Array) -> list[int]:
        change = Record(change_detection.Change)
        return [n for n, e in enumerate(errors.tolist()) if count("changed", change, e, 1.0, 0.01)]

    def test_one_change_is_one_kick_within_a_second(self) -> None:
        errors = np.random.default_rng(0).standard_normal(8000) * np.where(np.arange(8000) < 4000, 0.01, 0.5)
        kicks = self.kicks(errors)
        assert len(kicks) == 1
        assert 4000 < kicks[0] < 4100

    def test_reversals_and_outliers_are_none(self) -> None:
        n = np.arange(20_000)
        errors = 0.01 * np.random.default_rng(0).standard_normal(len(n))
        assert self.kicks(errors * np.where(n % 500 < 30, 20.0, 1.0)) == []
        assert self.kicks(errors * np.where(n % 700 == 0, 1e6, 1.0)) == []

    def test_errors_that_are_small_beside_the_forces_are_none(self) -> None:
        assert self.kicks(np.where(np.arange(8000) < 4000, 1e-7, 1e-4)) == []
