"""The paper reproduced: its numbers against closed forms and independent solutions."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from forefeel.common.recording.recording import Recording
from forefeel.studies.paper import memory as memory_module
from forefeel.studies.paper import windup as windup_module
from forefeel.studies.paper.contact import THETA, force_amplitude_n, rms, sines
from forefeel.studies.paper.identifiability import combination, unidentifiable
from forefeel.studies.paper.memory import memory, memory_s
from forefeel.studies.paper.online import Pairing, held, learn_paper, learn_safe
from forefeel.studies.paper.recordings import product_prediction
from forefeel.studies.paper.replay import ReplayedRun, baseline_row, motion_rows, replay, thinned
from forefeel.studies.paper.results import ErrorSummary, error_size, ratio
from forefeel.studies.paper.simulated import (
    expected_rms_n,
    lead_s,
    pairing,
    simulated_figure,
    siso_prediction,
)
from forefeel.studies.paper.thresholds import share_unfelt
from forefeel.studies.paper.unmodelled import expected_rms_n as expected_unmodelled_n
from forefeel.studies.paper.unmodelled import unmodelled
from forefeel.studies.paper.windup import expected_overflow_s, windup

Array = NDArray[np.float64]
DELAY_S = 0.3


def sampled(seed: int = 3, duration_s: float = 9.0, rate_hz: float = 50.0) -> Recording:
    """A hand's irregular motion, with a gap, against a spring with friction and an offset."""
    rng = np.random.default_rng(seed)
    time_s = np.cumsum(rng.uniform(0.5, 1.5, round(duration_s * rate_hz)) / rate_hz)
    time_s[len(time_s) // 2 :] += 0.5
    x = 0.01 * np.sin(2.1 * time_s) + 0.004 * np.sin(5.3 * time_s)
    v = np.gradient(x, time_s)
    force = 40.0 * x + 1.5 * v + 0.05 * np.sign(v) + 0.2 + 0.002 * rng.normal(size=len(time_s))
    return Recording("hand", time_s, x, force, "made up")


@pytest.mark.parametrize("omega", [0.5, 2.0, 5.0, 10.0])
def test_the_force_amplitude_is_that_of_the_simulated_contact(omega: float) -> None:
    motion = sines(2000.0, 4 * np.pi / omega, [(1.0, omega)])
    largest = np.abs(motion.rows() @ THETA).max()
    assert force_amplitude_n(THETA, omega) == pytest.approx(largest, rel=1e-4)


def test_the_derivatives_of_the_motion_are_those_of_the_position() -> None:
    motion = sines(5000.0, 3.0, [(1.0, 1.0), (0.3, 4.0)])
    for values, derivative in (
        (motion.position_m, motion.velocity_m_s),
        (motion.velocity_m_s, motion.acceleration_m_s2),
    ):
        np.testing.assert_allclose(
            np.gradient(values, motion.time_s)[1:-1], derivative[1:-1], atol=1e-5 * np.abs(derivative).max()
        )


# --- figures 4 and 5 ---


def test_figure_4_coincides_and_figure_5_leads_by_the_delay_when_paired_by_stamps() -> None:
    prompt, _ = simulated_figure(4, 0.0)
    delayed, _ = simulated_figure(5, DELAY_S)
    assert (prompt.error.max_n or 1.0) < 1e-9
    assert (delayed.error.max_n or 1.0) < 1e-9
    assert delayed.lead_s == pytest.approx(DELAY_S, abs=1e-6)
    assert delayed.newest_lead_s == pytest.approx(0.0, abs=1e-6)
    assert prompt.newest_error == prompt.error  # without delay both pairings are one
    for figure in (prompt, delayed):
        assert (figure.siso_error.max_n or 1.0) < 1e-6


def test_the_lead_is_how_far_one_sine_is_ahead() -> None:
    t = np.linspace(0.0, 15.0, 700)
    assert lead_s(t, 2.0 * np.sin(t + 0.7), np.sin(t + 0.5)) == pytest.approx(0.2)
    assert lead_s(t, np.sin(t), np.cos(t)) == pytest.approx(-np.pi / 2)


@pytest.mark.parametrize(("na", "nb"), [(1, 1), (2, 2), (3, 2)])
def test_equations_3_to_7_carry_a_known_system_across_the_delay(na: int, nb: int) -> None:
    a, b = np.array([-1.2, 0.5, -0.05])[:na] if na > 1 else np.array([-0.8]), np.array([0.7, -0.3])[:nb]
    rng = np.random.default_rng(4)
    u = rng.normal(size=300)
    y = np.zeros(300)
    for k in range(300):
        y[k] = -sum(a[i] * y[k - 1 - i] for i in range(na) if k > i)
        y[k] += sum(b[i] * u[k - 1 - i] for i in range(nb) if k > i)
    predicted = siso_prediction(np.arange(300) / 100.0, u, y, 0.07, na, nb)
    assert np.isnan(predicted[:7]).all()
    np.testing.assert_allclose(predicted[60:], y[60:], atol=1e-4)


# --- learning across a delay ---


@pytest.mark.parametrize("delay_s", [0.0, 0.013, 0.3])
def test_held_is_the_newest_force_that_has_arrived(delay_s: float) -> None:
    recording = sampled()
    assert recording.force_n is not None
    found = held(recording.time_s, recording.force_n, delay_s)
    for i, t in enumerate(recording.time_s):
        stamps = recording.time_s < t if delay_s == 0.0 else recording.time_s <= t - delay_s
        expected = recording.force_n[stamps][-1] if stamps.any() else np.nan
        np.testing.assert_equal(found[i], expected)


@pytest.mark.parametrize("pairing_by", ["stamps", "newest"])
def test_the_prediction_is_that_of_the_weighted_batch(pairing_by: Pairing) -> None:
    """At some instant: what weighted least squares over the pairs that have arrived says."""
    motion = sines(100.0, 6.0, [(1.0, 1.0), (0.5, 3.3)])
    rows, d, i, lam = motion.rows(), 30, 599, 0.96
    force = rows @ THETA + np.random.default_rng(5).normal(size=len(rows))
    made = learn_paper(motion.time_s, rows, force, 0.3, lam=lam, pairing=pairing_by)
    count = i - d + 1
    pairs = rows[:count] if pairing_by == "stamps" else rows[d : i + 1]
    weight = lam ** (0.5 * np.arange(count - 1, -1, -1.0))
    theta = np.linalg.lstsq(pairs * weight[:, None], force[:count] * weight, rcond=None)[0]
    assert made.predicted_n[i] == pytest.approx(rows[i] @ theta, rel=1e-6)
    np.testing.assert_allclose(made.theta[i], theta, rtol=1e-6)


PREDICTORS: dict[str, Callable[[Recording], Array]] = {
    "zoh": lambda r: replay(ReplayedRun("r", r), DELAY_S).zoh_n,
    "paper": lambda r: replay(ReplayedRun("r", r), DELAY_S).paper_n,
    "newest": lambda r: replay(ReplayedRun("r", r), DELAY_S).newest_n,
    "tared": lambda r: replay(ReplayedRun("r", r), DELAY_S).tared_n,
    # the scales come from the recording as a whole; so what is altered keeps its extremes
    "product": lambda r: product_prediction(r, DELAY_S),
}


@pytest.mark.parametrize("name", PREDICTORS)
def test_no_prediction_knows_the_future(name: str) -> None:
    """Forces after t - delay and motion after t, exchanged for each other, change nothing up to t."""
    recording = sampled()
    assert recording.force_n is not None
    middle = len(recording) // 2 + 40
    t = recording.time_s[middle]
    late = recording.time_s > t - DELAY_S
    force = recording.force_n.copy()
    force[late] = force[late][::-1]
    position = recording.position_m.copy()
    position[middle + 1 :] = position[middle + 1 :][::-1]
    altered = Recording("altered", recording.time_s, position, force, "made up")
    before, after = (PREDICTORS[name](r)[: middle + 1] for r in (recording, altered))
    if name == "product":  # the deviation of the force is the same up to rounding
        np.testing.assert_allclose(before, after, rtol=1e-9)
    else:
        np.testing.assert_array_equal(before, after)
    assert np.isfinite(before[-1])


def test_derivatives_are_causal_and_start_anew_behind_a_gap() -> None:
    time_s = np.concatenate([np.arange(200) * 0.01, 5.0 + np.arange(200) * 0.01])
    position = np.where(time_s < 3.0, 0.02 * time_s, 7.0)
    rows = motion_rows(Recording("r", time_s, position, None, "made up"))
    np.testing.assert_array_equal(rows[:, 2], position)
    assert rows[199, 1] == pytest.approx(0.02, rel=1e-3)
    np.testing.assert_array_equal(rows[200:, :2], 0.0)  # at rest, whatever came before


# --- (a) to (f) ---


def test_a_the_paper_finds_the_least_norm_and_the_product_says_what_it_can_not_know() -> None:
    """Without noise, from theta = 0 and P = I / delta, (8) to (12) tend to the least norm."""
    found, _ = unidentifiable()
    motion = sines(100.0, 20.0)
    least_norm = np.linalg.lstsq(motion.rows(), motion.rows() @ THETA, rcond=None)[0]
    np.testing.assert_allclose(found.paper, least_norm, atol=1e-6)
    np.testing.assert_allclose(found.paper, [-0.495, 0.1, 0.495], atol=1e-6)
    assert (found.paper_error.max_n or 1.0) < 1e-9
    assert found.paper_combination_n_m == pytest.approx(0.99)
    assert [row.paper_n for row in found.amplitudes] == pytest.approx([2.483, 12.88, 50.01], rel=1e-3)
    assert [row.true_n for row in found.amplitudes] == pytest.approx([0.9806, 0.9014, 1.0], rel=1e-3)
    assert found.product_says == ("m and k only as k - 1.00 m",)
    assert found.product[0] >= 0.0
    assert combination(np.array(found.product)) == pytest.approx(0.99, abs=1e-3)
    assert found.product_says_two_frequencies == ()
    np.testing.assert_allclose(found.product_two_frequencies, THETA, atol=1e-5)
    np.testing.assert_allclose(found.paper_two_frequencies, THETA, atol=1e-9)


def test_b_the_update_overflows_when_lambda_to_the_minus_k_does(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(windup_module, "LAMBDAS", (0.95, 0.96))
    monkeypatch.setattr(windup_module, "SEEDS", 1)
    found, traces = windup()
    for row, samples in zip(found.rows, (13568.4, 17048.8), strict=True):  # ln(1.797e308 * 1e-6) / -ln lambda
        assert row.overflow_s == pytest.approx(samples / 1000.0, rel=1e-3)
        assert row.expected_s == pytest.approx(samples / 1000.0, rel=1e-4)
        assert row.noisy_largest > 1e4  # by how much is the machine's rounding
        assert row.noisy_exceeds_s is None or row.noisy_exceeds_s < row.expected_s
        growth = traces.paper_growth[row.forgetting_factor]
        per_sample = (np.log(growth[-1]) - np.log(growth[-101])) / (100 * 20)
        assert per_sample == pytest.approx(-np.log(row.forgetting_factor), rel=1e-3)
    assert found.product_duration_s > expected_overflow_s(0.96)
    assert found.product_largest == pytest.approx(0.99, abs=0.01)
    assert found.product_largest_noisy == pytest.approx(0.99, abs=0.01)
    assert found.product_trace_growth <= 1.0


@pytest.mark.parametrize("rate_hz", [10.0, 1000.0])
def test_c_memory_is_the_time_in_which_a_weight_falls_to_1_over_e(rate_hz: float) -> None:
    assert 0.96 ** (rate_hz * memory_s(rate_hz)) == pytest.approx(np.exp(-1.0))


def test_c_more_samples_make_the_paper_worse_and_the_product_better(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory_module, "SEEDS", 2)
    found, _ = memory(DELAY_S)
    fast, middle, slow = found.rows
    # ill-conditioned: how bad it gets is the machine's rounding, that it gets worse is not
    assert fast.paper_rms_n > 10 * middle.paper_rms_n > 100 * slow.paper_rms_n
    assert fast.known_mass_rms_n > middle.known_mass_rms_n > slow.known_mass_rms_n
    assert fast.product_rms_n < middle.product_rms_n < slow.product_rms_n < 0.002
    for row in found.rows:
        assert row.paper_lowest_n <= row.paper_rms_n <= row.paper_highest_n


def test_d_an_unmodelled_force_leaves_what_m_b_k_can_not_take_up() -> None:
    motion = sines(1000.0, 2 * np.pi)
    columns = motion.rows()[:, 1:]
    for what, force in (("bias", np.ones(len(columns))), ("friction", np.sign(motion.velocity_m_s))):
        rest = force - columns @ np.linalg.lstsq(columns, force, rcond=None)[0]
        assert expected_unmodelled_n(what, 1.0) == pytest.approx(rms(rest), rel=5e-3)  # type: ignore[arg-type]
    found, _ = unmodelled(DELAY_S)
    for row in found.rows:
        assert row.ordinary_rms_n == pytest.approx(row.expected_n, rel=0.03)
        assert row.paper_rms_n > 0.9 * row.expected_n
        assert row.product_rms_n < 0.1 * row.expected_n


def test_f_the_wrong_pairing_learns_the_delayed_force() -> None:
    t = np.linspace(0.0, 2 * np.pi, 20_001)
    assert expected_rms_n(DELAY_S) == pytest.approx(
        rms(force_amplitude_n(THETA, 1.0) * (np.sin(t - DELAY_S) - np.sin(t))), rel=1e-3
    )
    figure, traces = simulated_figure(5, DELAY_S)
    late = traces.time_s >= figure.scored_from_s
    found = pairing(figure, error_size(traces.arrived_n[late], traces.force_n[late]))
    assert found.newest_rms_n == pytest.approx(found.expected_n, rel=1e-3)
    assert found.zoh_rms_n == pytest.approx(found.expected_n, rel=1e-3)
    assert (found.stamps_rms_n or 1.0) < 1e-9
    assert (found.product_rms_n or 1.0) < 1e-3


def test_the_safe_recursion_finds_the_parameters_that_the_motion_tells() -> None:
    motion = sines(100.0, 20.0, [(1.0, 1.0), (0.3, 4.0)])
    made, rls = learn_safe(motion.time_s, motion.rows(), motion.rows() @ THETA, DELAY_S)
    np.testing.assert_allclose(made.theta[-1], THETA, atol=1e-5)
    np.testing.assert_allclose(rls.parameters, made.theta[-1])
    assert np.isnan(made.predicted_n[:30]).all()
    assert made.overflow_s is None


# --- (e): runs ---


def test_e_a_run_is_scored_late_enough_and_against_the_hold() -> None:
    recording = sampled(duration_s=16.0)
    assert recording.force_n is not None
    made = replay(ReplayedRun("hand", recording, product_prediction(recording, DELAY_S)), DELAY_S)
    after = recording.time_s - recording.time_s[0]
    np.testing.assert_array_equal(made.scored, after >= 3.0 + DELAY_S)
    row = baseline_row(made)
    late = after >= 3.3
    hold = held(recording.time_s, recording.force_n, DELAY_S)
    expected = np.sqrt(np.mean((hold - recording.force_n)[late] ** 2))
    assert row.zoh.rms_n == pytest.approx(expected)
    assert row.product_over_zoh == pytest.approx((row.product.rms_n or 0.0) / expected)
    assert row.product_over_zoh is not None
    assert row.product_over_zoh < 0.5
    assert row.source == "recording"
    assert row.scored == late.sum()


def test_where_the_product_predicted_nothing_nothing_is_scored() -> None:
    recording = sampled()
    product = np.full(len(recording), np.nan)
    product[300:320] = 0.1
    made = replay(ReplayedRun("hand", recording, product), DELAY_S)
    assert np.flatnonzero(made.scored).tolist() == list(range(300, 320))
    nothing = baseline_row(replay(ReplayedRun("hand", recording, np.full(len(recording), np.nan)), DELAY_S))
    assert nothing.scored == 0
    assert nothing.zoh == ErrorSummary()
    assert nothing.paper_over_zoh is None


def test_thinning_keeps_every_nth_sample() -> None:
    recording = Recording("r", np.arange(1000) / 1000.0, np.arange(1000.0), None, "made up")
    few = thinned(recording, 100.0)
    assert few.rate_hz == pytest.approx(100.0)
    np.testing.assert_array_equal(few.position_m, np.arange(0.0, 1000.0, 10.0))


def test_an_error_is_unfelt_below_the_larger_of_both_thresholds() -> None:
    error = np.array([0.028, 0.030, -0.060, 0.060, 0.080])
    force = np.array([0.0, 0.1, -1.0, 0.5, 1.0])
    assert share_unfelt(error, force, 0.029, 0.07) == pytest.approx(2 / 5)  # the first and the third
    assert share_unfelt(error, force, 0.029, 0.0) == pytest.approx(1 / 5)
    assert share_unfelt(error, force, 0.0, 0.07) == pytest.approx(1 / 5)
    assert share_unfelt(error, force, 0.044, 0.10) == pytest.approx(4 / 5)
    assert share_unfelt(error[:0], force[:0], 0.029, 0.07) is None


def test_what_diverged_has_no_size_and_what_is_huge_does_not_overflow() -> None:
    zero = np.zeros(3)
    assert error_size(np.array([1.0, np.nan, 1.0]), zero) == ErrorSummary()
    assert error_size(np.array([1.0, np.inf, 1.0]), zero) == ErrorSummary()
    assert error_size(np.full(3, 1e200), zero).rms_n == pytest.approx(1e200)
    assert error_size(np.array([3.0, 4.0, 0.0]), zero).rms_n == pytest.approx(5.0 / np.sqrt(3.0))
    assert ratio(ErrorSummary(rms_n=1.0), ErrorSummary(rms_n=0.0)) is None
    assert ratio(ErrorSummary(rms_n=1e300), ErrorSummary(rms_n=1e-300)) is None
    assert ratio(ErrorSummary(rms_n=1.0), ErrorSummary(rms_n=4.0)) == 0.25
