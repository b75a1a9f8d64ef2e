"""Least squares, weights, gain, band and the notice of a change, each against an oracle of its own."""

from typing import ClassVar

import numpy as np
import pytest
from numpy.typing import NDArray

from forefeel.common.estimation.forecast import band as bands
from forefeel.common.estimation.forecast import change as changes
from forefeel.common.estimation.forecast import experts as crowd
from forefeel.common.estimation.forecast import hold as holds
from forefeel.common.estimation.forecast import regression as fits
from forefeel.common.estimation.forecast import steps
from forefeel.common.estimation.forecast.bank import (
    COUNT,
    FIRST_DIFFERENCE,
    FIRST_NONLINEAR,
    FIRST_RELAXATION,
    FIRST_STOP,
)
from forefeel.common.estimation.forecast.regression import LONG, SETS, SHORT, SHORT_SETS
from forefeel.common.estimation.forecast.state import new_state
from forefeel.common.jit import zeros
from tests.unit.forecast_samples import contact

Array = NDArray[np.float64]


class TestLeastSquares:
    """R, r and theta from the regressors themselves, by numpy and the formulas of the module's text."""

    MEMORIES_S: ClassVar = {LONG: 120.0, SHORT: 8.0}
    RHO_S: ClassVar = {LONG: 0.05, SHORT: 1.0}
    W = 5e-3

    def learned(self) -> tuple[NDArray[np.void], Array, Array]:
        """(state, phi of every learned force, force less f0), from when the ranges are known on."""
        sample = contact(16.0)
        states = new_state(0)
        regression = states[0]["regression"]
        first = 1200
        for n in range(len(sample.t)):
            steps.move(states, sample.t[n], sample.x[n], np.nan, np.nan)
            if n == first:
                for name in ("information", "moments"):
                    regression[name][:] = 0.0
                regression["weight_long"] = 0.0
                octave = float(states[0]["bank"]["octave"])
            steps.observe(states, sample.t[n], sample.f[n])
        assert states[0]["bank"]["octave"] == octave
        rows = slice(first, len(sample.t))
        regression["solved_s"] = -1.0
        fits.solve(states["regression"][0])
        phi = np.array(states[0]["bank"]["phi"][rows])
        return states, phi, sample.f[rows] - regression["force0_n"]

    def expected(self, phi: Array, y: Array) -> tuple[dict[int, Array], dict[int, Array], float]:
        information, moments = {}, {}
        ages = np.arange(len(y))[::-1]
        for memory, memory_s in self.MEMORIES_S.items():
            weights = self.W * np.exp(-ages * self.W / memory_s)
            information[memory] = (phi * weights[:, None]).T @ phi
            moments[memory] = phi.T @ (weights * y)
        return information, moments, float(np.sum(self.W * np.exp(-ages * self.W / self.MEMORIES_S[LONG])))

    def ridge(self, memory: int, information: Array, weight: float) -> Array:
        shares = np.ones(COUNT)
        shares[0], shares[2:4], shares[FIRST_DIFFERENCE:FIRST_NONLINEAR] = 1e-3, 0.1, 0.1
        shares[FIRST_NONLINEAR:] = 3.0
        usual = np.diag(information) / weight
        usual[FIRST_STOP:FIRST_RELAXATION] = np.maximum(usual[FIRST_STOP:FIRST_RELAXATION], 0.3)
        return np.asarray(self.RHO_S[memory] * shares * usual + 1e-10 * np.diag(information))

    def test_theta_of_all_sets_in_both_memories(self) -> None:
        states, phi, y = self.learned()
        information, moments, weight = self.expected(phi, y)
        got = states[0]["regression"]
        assert got["weight_long"] == pytest.approx(weight, rel=1e-9)
        for memory, sets in ((LONG, range(len(SETS))), (SHORT, SHORT_SETS)):
            d = self.ridge(memory, information[LONG], weight)
            for k in sets:
                m = SETS[k]
                prior = got["theta"][LONG, k, :m] if memory == SHORT else np.zeros(m)
                matrix = information[memory][:m, :m] + np.diag(d[:m])
                theta = np.linalg.solve(matrix, moments[memory][:m] + d[:m] * prior)
                here, there = phi[:, :m] @ theta, phi[:, :m] @ got["theta"][memory, k, :m]
                assert np.abs(here - there).max() < 1e-6 * np.ptp(y), (memory, k)

    def test_the_lower_triangle_is_the_information(self) -> None:
        states, phi, y = self.learned()
        information, moments, _ = self.expected(phi, y)
        got = states[0]["regression"]
        lower = np.tril_indices(COUNT)
        for memory in (LONG, SHORT):
            scale = np.sqrt(np.outer(np.diag(information[memory]), np.diag(information[memory]))) + 1e-300
            assert np.abs((got["information"][memory] - information[memory]) / scale)[lower].max() < 1e-9
            size = np.sqrt(np.diag(information[memory]) * np.sum(y**2) * self.W) + 1e-300
            assert (np.abs(got["moments"][memory] - moments[memory]) / size).max() < 1e-9

    def test_a_kick_leaves_the_weight_of_a_fifth_of_a_second(self) -> None:
        states, _, _ = self.learned()
        regression = states["regression"][0]
        before = np.array(regression["information"])
        fits.discount(regression)
        assert regression["weight_long"] == pytest.approx(0.2)
        shares = regression["information"][:, 0, 0] / before[:, 0, 0]
        assert (shares < 0.05).all()


def test_standing_still_neither_adds_nor_forgets() -> None:
    sample = contact(6.0)
    states = new_state(0)
    still = np.concatenate((sample.x, np.full(2000, sample.x[-1])))
    for n, x in enumerate(still.tolist()):
        t = n * 5e-3
        steps.move(states, t, x, np.nan, np.nan)
        steps.observe(states, t, float(sample.f[min(n, 1199)]))
        if n == 1199 + 500:
            before = np.array(states[0]["regression"]["information"])
    np.testing.assert_array_equal(states[0]["regression"]["information"], before)


def test_weights_are_the_fourth_power_of_the_errors_seen() -> None:
    rng = np.random.default_rng(0)
    record = zeros(crowd.DTYPE)
    crowd.begin(record, crowd.MODELS)
    experts, count, w, range_n = record[0], crowd.COUNT, 0.01, 5.0
    errors = rng.standard_normal((300, count)) * np.linspace(0.1, 2.0, count)
    for n in range(300):
        experts["predicted_n"][n] = 1.0 + errors[n]
        crowd.judge(experts, n, 1.0, 0.5, range_n, w)
    ages = np.arange(300)[::-1]
    mse = np.zeros(count)
    for memory_s, share in ((2.0, 0.7), (8.0, 0.3)):
        fading = np.exp(-ages * w / memory_s)
        mse += share * (fading @ errors**2) / fading.sum()
    mse += (0.005 * range_n) ** 2
    cold = np.arange(count) < crowd.TAUGHT  # who was taught by another run is not new to it
    mse += cold * (0.1 * range_n) ** 2 / (1 + 300 * w * 0.5**2 / (0.02 * range_n**2))
    expected = mse**-4 / np.sum(mse**-4)
    np.testing.assert_allclose(experts["weights"], expected, rtol=1e-9)
    force_n, leading = crowd.blend(experts, 299)
    assert force_n == pytest.approx(1.0 + errors[299] @ expected, rel=1e-12)
    assert leading == np.argmax(expected)
    variance = expected @ (errors[299] + 1.0 - force_n) ** 2
    assert crowd.spread(experts, 299, force_n) == pytest.approx(variance, rel=1e-9)


class TestGain:
    def learned(self, deviations: Array, needed: Array) -> NDArray[np.void]:
        gain = zeros(holds.DTYPE)
        for d, y in zip(deviations.tolist(), needed.tolist(), strict=True):
            holds.learn(gain[0], d, y, 0.01)
        return gain

    def test_deviations_that_were_right_are_applied_and_those_that_were_noise_are_not(self) -> None:
        rng = np.random.default_rng(1)
        small = 0.01 * rng.standard_normal(3000)
        large = 4.0 * np.sign(rng.standard_normal(3000))
        deviations = np.stack((small, large), axis=1).ravel()
        needed = np.stack((0.01 * rng.standard_normal(3000), large), axis=1).ravel()
        gain = self.learned(deviations, needed)[0]
        assert holds.applied(gain, 4.0, 0.02, 10.0, 0.0) == pytest.approx(4.0, rel=0.01)
        assert abs(holds.applied(gain, 0.01, 0.02, 10.0, 0.0)) < 0.003

    @pytest.mark.parametrize("share", [0.25, 0.6])
    def test_the_share_is_the_regression_of_what_was_needed(self, share: float) -> None:
        d = np.random.default_rng(2).uniform(0.9, 1.1, 4000)
        gain = self.learned(d, share * d)[0]
        assert holds.applied(gain, 1.0, 0.02, 10.0, 0.0) == pytest.approx(share, abs=0.05)

    def test_what_another_run_has_taught_goes_as_far_as_it_says_at_once(self) -> None:
        gain = zeros(holds.DTYPE)[0]
        gain["largest_error_n"] = 0.1
        capped, free = (holds.applied(gain, 2.0, 0.3, 0.1, taught) for taught in (0.0, 1.0))
        assert capped == pytest.approx(0.1)
        assert free == pytest.approx(2.0)

    def test_a_wrong_sign_is_not_turned_round(self) -> None:
        d = np.random.default_rng(2).uniform(0.9, 1.1, 4000)
        assert holds.applied(self.learned(d, -d)[0], 1.0, 0.02, 10.0, 0.0) == pytest.approx(0.0, abs=1e-9)

    def test_before_anything_was_seen_an_old_force_is_left_for_the_blend(self) -> None:
        gain = zeros(holds.DTYPE)[0]
        assert holds.applied(gain, 1.0, 0.3, 10.0, 0.0) == pytest.approx(1.0)


class TestBand:
    def covered(self, errors: Array, w: float, late: int = 60) -> NDArray[np.bool_]:
        """Which errors are inside, when each is seen only `late` samples after its band was given."""
        band = zeros(bands.DTYPE)
        bands.begin(band)
        given: list[tuple[float, float]] = []
        inside = np.zeros(len(errors), dtype=np.bool_)
        for n, error in enumerate(errors.tolist()):
            if n >= late:
                bands.learn(band[0], float(errors[n - late]), *given[n - late], w)
            scale_n = bands.scale_n(band[0], 0.0, 0.0, 1.0)
            half_n = bands.half_width_n(band[0], scale_n, 0.0, 1.0)
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
        band = zeros(bands.DTYPE)
        bands.begin(band)
        half_n = scale_n = 1.0
        for error in errors.tolist():
            bands.learn(band[0], error, half_n, scale_n, 5e-3)
            scale_n = bands.scale_n(band[0], 0.0, 0.0, 1.0)
            half_n = bands.half_width_n(band[0], scale_n, 0.0, 1.0)
        assert half_n == pytest.approx(1.96, rel=0.25)

    def test_the_quantile_is_numpys(self) -> None:
        scores = np.abs(np.random.default_rng(6).standard_t(4, 1000))
        band = zeros(bands.DTYPE)
        for score in scores.tolist():
            bands.learn(band[0], score, np.inf, 1.0, 1e-6)
        width = bands.half_width_n(band[0], 1.0, 0.0, 1.0)
        assert width == pytest.approx(np.quantile(scores, 0.95), rel=0.05)


class TestChange:
    def kicks(self, errors: Array) -> list[int]:
        change = zeros(changes.DTYPE)[0]
        return [n for n, e in enumerate(errors.tolist()) if changes.noticed(change, e, 1.0, 0.01)]

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
