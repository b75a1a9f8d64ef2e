"""Each regressor against what it is by definition: polynomials, plays, exponentials."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from forefeel.common.estimation.bank import (
    FIRST_DIFFERENCE,
    FIRST_NONLINEAR,
    FIRST_RELAXATION,
    FIRST_STOP,
    RELAXATIONS_S,
    SPANS,
    STOPS,
)
from forefeel.common.estimation.evaluator import Evaluator
from forefeel.common.kernels.record import Array
from tests.unit.inner_kernels import count

RNG = np.random.default_rng(3)
TIME_S = np.cumsum(RNG.uniform(0.8e-3, 1.2e-3, 3000))


def moved(t: NDArray[np.floating[Any]], x: NDArray[np.floating[Any]]) -> Evaluator:
    evaluator = Evaluator()
    for stamp, position in zip(t.tolist(), x.tolist(), strict=True):
        evaluator.move(stamp, position, position, 0.0)
    return evaluator


def bank_of(t: NDArray[np.floating[Any]], x: NDArray[np.floating[Any]]) -> Any:  # noqa: ANN401 - a record
    return moved(t, x).record.values["bank"]


def test_differences_are_the_derivatives_of_a_cubic_at_irregular_stamps() -> None:
    coefficients = np.array([0.3, -0.2, 0.4, 0.01])  # cubic, ..., constant
    bank = bank_of(TIME_S, np.polyval(coefficients, TIME_S))
    phi, newest = bank["phi"][len(TIME_S) - 1], len(TIME_S) - 1
    third = 6 * coefficients[0]
    for j, span in enumerate(SPANS):
        t0, t1, t2 = (TIME_S[newest - k * span] for k in range(3))
        quadratic = np.polyfit([t0, t1, t2], np.polyval(coefficients, [t0, t1, t2]), 2)
        line = np.polyfit([t0, t1], np.polyval(coefficients, [t0, t1]), 1)
        first, second, got_third = phi[FIRST_DIFFERENCE + 3 * j : FIRST_DIFFERENCE + 3 * j + 3]
        assert first == pytest.approx(line[0], rel=1e-6)
        assert second == pytest.approx(2 * quadratic[0], rel=2e-3)
        assert got_third == pytest.approx(third, rel=0.1 if span < 4 else 5e-3)


def test_after_a_gap_no_difference_reaches_across_it() -> None:
    """At first those of the last piece stand, then the shorter spans', then each its own."""
    t = np.arange(60) * 1e-3
    t = np.concatenate((t, t + 1.0))
    bank = bank_of(t, np.where(t < 0.5, 2.0 * t, 5.0 - 3.0 * t))
    speeds = bank["phi"][:, FIRST_DIFFERENCE:FIRST_NONLINEAR:3]
    np.testing.assert_allclose(speeds[50:63], 2.0, rtol=1e-9)
    np.testing.assert_allclose(speeds[63:120], -3.0, rtol=1e-9)
    quadratic = bank_of(t, np.where(t < 0.5, 2.0 * t, -2.0 * t - t**2))["phi"][:, FIRST_DIFFERENCE + 3 * 2]
    shorter, own = 60 + 3 * SPANS[2] - 1, 60 + 3 * SPANS[2]
    assert quadratic[shorter] == pytest.approx(-2.0 - t[shorter] - t[shorter - SPANS[1]], rel=1e-6)
    assert quadratic[own] == pytest.approx(-2.0 - t[own] - t[own - SPANS[2]], rel=1e-6)


def brute_force_stop(x: Array, radius: float) -> float:
    """From the play operator's own definition: z = x - w, with w following x at the distance r."""
    play = x[0]
    for position in x:
        play = max(position - radius, min(position + radius, play))
    return float(x[-1] - play)


def test_stops_are_the_stop_operators_of_their_radii() -> None:
    t = np.arange(4000) * 1e-3
    wide = 0.01 * np.sin(2 * np.pi * 3 * t)
    x = np.where(t < 1.0, wide, wide * (0.3 + 0.7 * np.cos(2 * np.pi * 0.9 * t) ** 2))
    bank = bank_of(t, x)
    median = np.median(np.stack((x[:-2], x[1:-1], x[2:])), axis=0)
    radii = bank["radii_m"]
    assert sorted(np.log2(radii).tolist()) == list(range(int(bank["octave"]) - STOPS, int(bank["octave"])))
    for j in range(STOPS):
        expected = brute_force_stop(median, radii[j]) / radii[j]
        assert bank["phi"][len(t) - 1, FIRST_STOP + j] == pytest.approx(expected, abs=1e-9)


def test_a_new_octave_takes_one_slot_and_leaves_the_others() -> None:
    t = np.arange(3000) * 1e-3
    before = bank_of(t[:1500], 1e-3 * np.sin(2 * np.pi * t[:1500]))
    after = bank_of(t, np.where(t < 1.5, 1e-3, 2.5e-3) * np.sin(2 * np.pi * t))
    assert after["octave"] == before["octave"] + 1
    assert np.count_nonzero(after["radii_m"] != before["radii_m"]) == 1


@pytest.mark.parametrize("j", range(len(RELAXATIONS_S)))
def test_relaxation_of_a_step_is_an_exponential(j: int) -> None:
    t, at, held = np.arange(4000) * 1e-3, 1000, 1010
    x = np.where(np.arange(4000) < at, 2e-3 * np.sin(2 * np.pi * t), 1e-3)
    early = bank_of(t[: held + 1], x[: held + 1])["phi"][held, FIRST_RELAXATION + j]
    late = bank_of(t, x)["phi"][3999, FIRST_RELAXATION + j]
    assert late == pytest.approx(early * np.exp(-(t[3999] - t[held]) / RELAXATIONS_S[j]), rel=1e-6, abs=1e-15)


def test_bias_position_and_powers() -> None:
    t = np.arange(1000) * 1e-3
    x = 5.0 + 0.01 * np.sin(7 * t)
    phi, offset = bank_of(t, x)["phi"][999], x[999] - x[1]
    assert phi[0] == 1.0
    assert phi[1] == pytest.approx(offset, rel=1e-12)
    assert phi[FIRST_NONLINEAR + 3 : FIRST_NONLINEAR + 5] == pytest.approx([offset**2, offset**3], rel=1e-9)


def test_finding_a_sample_by_its_stamp() -> None:
    record = moved(TIME_S, np.sin(TIME_S)).record
    assert [count("find", record, float(TIME_S[k])) for k in (0, 1, 77, 2999)] == [0, 1, 77, 2999]
    for stamp in (float(TIME_S[5]) + 2e-4, -1.0, 1e9):
        assert count("find", record, stamp) == -1
    assert record.values["bank"]["count"] == 3000
