"""What arrives is not always what was sent: outliers, bursts of no numbers, odd stamps, loss, odd scales."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from forefeel.common.estimation.predictor import Predictor
from tests.unit.predictor_samples import Array, Sample, contact, replayed, scored

DELAY_S = 0.3
SAMPLE = contact()
ROWS = scored(SAMPLE, DELAY_S)


@cache
def clean_rms() -> float:
    """Error in N on the sample as it is."""
    return replayed(SAMPLE, DELAY_S).rms(SAMPLE.f, ROWS)


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


@pytest.mark.parametrize(
    ("column", "at", "by", "worse"),
    [
        ("x", 0, 10.0, 1.1), ("x", 700, -1e6, 1.1), ("x", 700, 4e-3, 1.1),
        ("f", 0, 1e6, 1.2), ("f", 2, -30.0, 1.2), ("f", 700, 1e6, 1.2),  # it is not even held
    ],
)  # fmt: skip
def test_one_position_or_force_far_out_leaves_no_trace(column: str, at: int, by: float, worse: float) -> None:
    other = getattr(SAMPLE, column).copy()
    other[at] += by
    said = replayed(replace(SAMPLE, **{column: other}), DELAY_S)
    assert said.rms(SAMPLE.f, ROWS) < worse * clean_rms()


def test_gaps_begin_new_pieces_and_nothing_blows_up() -> None:
    sample = replace(SAMPLE, t=SAMPLE.t + 3.0 * (SAMPLE.t > 8.0) + 0.3 * (SAMPLE.t > 14.0))
    assert replayed(sample, DELAY_S).rms(SAMPLE.f, scored(sample, DELAY_S)) < 1.5 * clean_rms()


def live(predictor: Predictor, count: int) -> Iterator[int]:
    """Motion, and forces that come 60 samples late; each number after its motion, before its prediction."""
    for n in range(count):
        predictor.move(SAMPLE.t[n], SAMPLE.x[n])
        if n >= 60:
            predictor.observe(SAMPLE.t[n - 60], SAMPLE.f[n - 60])
        yield n
        predictor.predict()


def test_other_samples_of_a_stamp_and_those_of_no_stamp_change_nothing_learned() -> None:
    plain, pestered = Predictor(), Predictor()
    for n, _ in zip(live(pestered, 1500), live(plain, 1500), strict=True):
        pestered.move(SAMPLE.t[n], 1.0)
        pestered.move(SAMPLE.t[max(n - 1, 0)], 2.0)
        pestered.move(float("nan"), 3.0)
        pestered.move(float("inf"), 3.0)
        if n >= 60:
            pestered.observe(SAMPLE.t[n - 60], -7.0)
    pestered.observe(SAMPLE.t[900] + 1e-3, SAMPLE.f[900])
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


@pytest.mark.parametrize("x", [SAMPLE.x, np.full_like(SAMPLE.x, 0.01)], ids=["moved", "at rest"])
def test_a_constant_force_is_predicted_exactly(x: Array) -> None:
    said = replayed(Sample(SAMPLE.t, x, np.full_like(SAMPLE.f, 3.0)), DELAY_S)
    assert set(said.force[ROWS]) == {3.0}


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
    predictor, errors_n = Predictor(), list[float]()
    for n in live(predictor, len(SAMPLE.t)):
        if n == 2400:
            predictor.restart()
            predictor.move(SAMPLE.t[n], SAMPLE.x[n])
        if (estimate := predictor.predict()) is not None:
            errors_n.append(estimate.force_n - SAMPLE.f[n])
    assert np.sqrt(np.mean(np.square(errors_n[2400:]))) < 2.0 * clean_rms()


def test_nothing_is_said_before_both_a_force_and_a_motion() -> None:
    predictor, only_motion = Predictor(), Predictor()
    only_motion.move(0.0, 0.1)
    assert predictor.predict() is only_motion.predict() is None
    predictor.observe(0.0, 1.0)
    assert predictor.predict() is None
    predictor.move(0.0, 0.1)
    estimate = predictor.predict()
    assert estimate is not None
    assert estimate.low_n <= estimate.force_n == 1.0 <= estimate.high_n
