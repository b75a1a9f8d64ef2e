"""What arrives is not always what was sent: outliers, bursts of no numbers, odd stamps, loss, odd scales."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from forefeel.common.estimation import blend as blends
from forefeel.common.estimation.predictor import Predictor
from tests.unit.predictor_samples import Array, Sample, contact, replayed, scored

DELAY_S = 0.3
SAMPLE = contact()
ROWS = scored(SAMPLE, DELAY_S)


@cache
def clean_rms() -> float:
    """Error in N on the sample as it is."""
    return replayed(SAMPLE, DELAY_S).rms(SAMPLE.f, ROWS)


def changed(column: Array, at: int, by: float) -> Array:
    other = column.copy()
    other[at] += by
    return other


@pytest.mark.parametrize(("at", "by"), [(0, 10.0), (700, -1e6), (700, 4e-3)], ids=str)
def test_one_position_far_out_leaves_no_trace(at: int, by: float) -> None:
    said = replayed(replace(SAMPLE, x=changed(SAMPLE.x, at, by)), DELAY_S)
    assert said.rms(SAMPLE.f, ROWS) < 1.1 * clean_rms()


@pytest.mark.parametrize(("at", "by"), [(0, 1e6), (2, -30.0), (700, 1e6)], ids=str)
def test_one_force_far_out_is_not_even_held(at: int, by: float) -> None:
    said = replayed(replace(SAMPLE, f=changed(SAMPLE.f, at, by)), DELAY_S)
    assert said.rms(SAMPLE.f, ROWS) < 1.2 * clean_rms()


def test_a_regrip_far_away_is_believed_and_learned() -> None:
    x = np.where(SAMPLE.t < 8.0, SAMPLE.x, SAMPLE.x + 0.05)
    said = replayed(replace(SAMPLE, x=x), DELAY_S)
    later = SAMPLE.t > 12.0
    assert said.rms(SAMPLE.f, later) < 0.5 * said.zoh_rms(SAMPLE.f, later)


def test_bursts_of_no_numbers_in_both_signals() -> None:
    x, f = SAMPLE.x.copy(), SAMPLE.f.copy()
    for start in range(400, len(x), 700):
        f[start : start + 10] = np.nan
        x[start + 5 : start + 20] = np.inf
    said = replayed(Sample(SAMPLE.t, x, f), DELAY_S)
    assert np.isfinite(said.force[ROWS]).all()
    assert said.rms(SAMPLE.f, ROWS) < 1.5 * clean_rms()


def test_the_order_of_arrival_between_two_samples_hardly_matters() -> None:
    batches = SAMPLE.t + DELAY_S + 0.05 - np.mod(SAMPLE.t, 0.05)
    backwards = batches - 1e-6 * np.arange(len(batches)) / len(batches)
    forth, back = (replayed(SAMPLE, DELAY_S, arrival) for arrival in (batches, backwards))
    assert back.rms(SAMPLE.f, ROWS) == pytest.approx(forth.rms(SAMPLE.f, ROWS), rel=0.1)


def test_gaps_begin_new_pieces_and_nothing_blows_up() -> None:
    t = SAMPLE.t + 3.0 * (SAMPLE.t > 8.0) + 0.3 * (SAMPLE.t > 14.0)
    sample = replace(SAMPLE, t=t)
    said, rows = replayed(sample, DELAY_S), scored(sample, DELAY_S)
    assert said.rms(SAMPLE.f, rows) < 1.5 * clean_rms()


def test_a_second_force_of_a_stamp_and_one_of_no_stamp_change_nothing_learned() -> None:
    plain, pestered = Predictor(), Predictor()
    for predictor in (plain, pestered):
        for n in range(1500):
            predictor.move(SAMPLE.t[n], SAMPLE.x[n])
            if n >= 60:
                predictor.observe(SAMPLE.t[n - 60], SAMPLE.f[n - 60])
                if predictor is pestered:
                    predictor.observe(SAMPLE.t[n - 60], -7.0)
            predictor.predict()
    pestered.observe(SAMPLE.t[900] + 1e-3, SAMPLE.f[900])
    assert plain.predict() == pestered.predict()


def test_motion_whose_stamp_does_not_increase_is_left_out() -> None:
    plain, pestered = Predictor(), Predictor()
    for predictor in (plain, pestered):
        for n in range(600):
            predictor.move(SAMPLE.t[n], SAMPLE.x[n])
            if predictor is pestered and n > 0:
                predictor.move(SAMPLE.t[n], 1.0)
                predictor.move(SAMPLE.t[n - 1], 2.0)
                predictor.move(float("nan"), 3.0)
            if n >= 60:
                predictor.observe(SAMPLE.t[n - 60], SAMPLE.f[n - 60])
    assert plain.predict() == pestered.predict()


def test_forces_ahead_of_the_motion_wait_for_it() -> None:
    early = Predictor()
    for n in range(900):
        early.observe(SAMPLE.t[n], SAMPLE.f[n])
        early.move(SAMPLE.t[n], SAMPLE.x[n])
    early.observe(1e9, 5.0)
    early.observe(float("inf"), 5.0)
    estimate = early.predict()
    assert estimate is not None
    assert estimate.force_n == pytest.approx(SAMPLE.f[899], abs=1e-9)


def test_a_delay_longer_than_what_is_kept_becomes_the_hold() -> None:
    sample = contact(60.0, 200.0)
    said = replayed(sample, 45.0)
    rows = sample.t > 48.0
    np.testing.assert_array_equal(said.force[rows], said.held[rows])
    assert set(np.array(said.leading)[rows]) == {"zoh"}
    assert np.mean((said.low <= sample.f) & (sample.f <= said.high), where=rows) > 0.9


@pytest.mark.parametrize(
    "sample",
    [
        Sample(SAMPLE.t, SAMPLE.x, np.full_like(SAMPLE.f, 3.0)),
        Sample(SAMPLE.t, np.full_like(SAMPLE.x, 0.01), np.full_like(SAMPLE.f, -2.0)),
    ],
    ids=["constant force", "constant force and position"],
)
def test_a_constant_force_is_predicted_exactly(sample: Sample) -> None:
    said = replayed(sample, DELAY_S)
    np.testing.assert_array_equal(said.force[ROWS], sample.f[ROWS])


def of_experts(sample: Sample) -> Array:
    """What the zero-order hold and the five experts say, by sample."""
    predictor = Predictor()
    for n in range(1500):
        if n >= 60:
            predictor.observe(sample.t[n - 60], sample.f[n - 60])
        predictor.move(sample.t[n], sample.x[n])
        predictor.predict()
    said_n: Array = predictor._evaluator.record.values["members_n"][:1500, : blends.CONTACT]
    return said_n


@pytest.mark.parametrize(("of_x", "of_f"), [(2.0**20, 1.0), (1.0, 2.0**-30)])
def test_powers_of_two_of_a_unit_change_nothing_for_the_experts(of_x: float, of_f: float) -> None:
    said_n = of_experts(Sample(SAMPLE.t, SAMPLE.x * of_x, SAMPLE.f * of_f))
    np.testing.assert_allclose(said_n / of_f, of_experts(SAMPLE), rtol=0, atol=1e-9)


@pytest.mark.parametrize(("of_x", "of_f"), [(1e-9, 1e-6), (1e6, 1e6)])
def test_any_unit_does(of_x: float, of_f: float) -> None:
    said = replayed(Sample(SAMPLE.t, SAMPLE.x * of_x, SAMPLE.f * of_f), DELAY_S)
    assert said.rms(SAMPLE.f * of_f, ROWS) < 1.1 * clean_rms() * of_f


@pytest.mark.parametrize(("rate_hz", "duration_s", "share"), [(60.0, 20.0, 0.3), (10_000.0, 4.5, 0.3)])
def test_any_rate_does(rate_hz: float, duration_s: float, share: float) -> None:
    sample = contact(duration_s, rate_hz)
    said, rows = replayed(sample, DELAY_S), scored(sample, DELAY_S)
    assert said.rms(sample.f, rows) < share * said.zoh_rms(sample.f, rows)


def test_restart_keeps_what_was_learned() -> None:
    predictor = Predictor()
    errors: list[float] = []
    for n in range(len(SAMPLE.t)):
        if n >= 60:
            predictor.observe(SAMPLE.t[n - 60], SAMPLE.f[n - 60])
        if n == 2400:
            predictor.restart()
        predictor.move(SAMPLE.t[n], SAMPLE.x[n])
        if (estimate := predictor.predict()) is not None:
            errors.append(estimate.force_n - SAMPLE.f[n])
    after: NDArray[np.float64] = np.array(errors[2400:])
    assert float(np.sqrt(np.mean(after**2))) < 2.0 * clean_rms()


def test_nothing_is_said_before_both_a_force_and_a_motion() -> None:
    predictor = Predictor()
    assert predictor.predict() is None
    predictor.observe(0.0, 1.0)
    assert predictor.predict() is None
    predictor.move(0.0, 0.1)
    estimate = predictor.predict()
    assert estimate is not None
    assert estimate.force_n == 1.0
    assert estimate.low_n <= 1.0 <= estimate.high_n
    only_motion = Predictor()
    only_motion.move(0.0, 0.1)
    assert only_motion.predict() is None


def test_after_a_sensors_garbage_the_predictor_begins_anew_and_beats_the_hold() -> None:
    garbage = (SAMPLE.t > 4.0) & (SAMPLE.t < 7.0)
    forces_n = np.where(garbage, 1e6 * np.sin(700.0 * SAMPLE.x), SAMPLE.f)
    predictor, said_n = Predictor(), np.full_like(SAMPLE.f, np.nan)
    for n in range(len(SAMPLE.t)):
        if n >= 60:
            predictor.observe(SAMPLE.t[n - 60], forces_n[n - 60])
        predictor.move(SAMPLE.t[n], SAMPLE.x[n])
        if (estimate := predictor.predict()) is not None:
            said_n[n] = estimate.force_n
    assert predictor.learner.renewals > 0
    errors_n = np.stack((said_n - SAMPLE.f, np.roll(SAMPLE.f, 60) - SAMPLE.f))[:, SAMPLE.t > 15.0]
    predicted_n, held_n = np.sqrt(np.mean(errors_n**2, axis=1))
    assert predicted_n < 0.5 * held_n
