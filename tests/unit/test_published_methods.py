"""The published methods of `benchmarks.prediction` on contacts that they describe, and the sign test."""

from collections.abc import Sequence

import numpy as np
import pytest

from benchmarks import prediction_published as published
from benchmarks.prediction import Row, scored, sign_test
from benchmarks.prediction_published import OfflineNetworks, contact_in_hindsight, instrument
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.evaluation.arrivals import DelayedLink
from forefeel.diagnosis.evaluation.evaluate import prepare
from tests.unit.evaluation_samples import Floats, made_up, recording

T: Floats = np.arange(0.0, 20.0, 0.01)
X = 0.004 * np.sin(2 * np.pi * 0.4 * T) + 0.002 * np.sin(2 * np.pi * 1.1 * T)
DEPTH: Floats = np.maximum(X - 0.001, 0.0)
V: Floats = np.gradient(X, T)


def ratios(force_n: Floats, *methods: str) -> Sequence[float]:
    prepared = prepare(recording(T, X, force_n), DelayedLink(0.3))
    rows = scored("made up", "made up", prepared, methods, OfflineNetworks({}))
    return [row.ratio or 0.0 for row in rows]


def test_a_kelvin_voigt_contact_is_found_and_foretold() -> None:
    force_n = -0.2 - (DEPTH > 0) * (300.0 * DEPTH + 2.0 * V)
    found = contact_in_hindsight(prepare(recording(T, X, force_n), DelayedLink(0.3)), None)
    assert found.side == 1.0
    assert found.position_m == pytest.approx(0.001, abs=0.02 * np.ptp(X))
    assert found.force_n == pytest.approx(-0.2, abs=0.05)
    assert ratios(force_n, "kv_ewrls")[0] < 0.1


def test_a_hunt_crossley_contact_is_foretold_better_by_its_own_model() -> None:
    force_n = (DEPTH / 0.005) ** 2 * (1.0 + 2.0 * V) + np.random.default_rng(1).normal(0.0, 1e-3, len(T))
    kv, hc = ratios(force_n, "kv_ewrls", "hc_ewrls")
    assert hc < 0.5 * kv < 0.25


def test_a_pseudo_derivative_becomes_the_stiffness() -> None:
    assert ratios(50.0 * X, "model_free")[0] < 0.05


def test_a_network_never_sees_its_own_instrument(monkeypatch: pytest.MonkeyPatch) -> None:
    class Listening:
        def __init__(self, penalty: float) -> None: ...

        def fit(self, rows: Floats, targets: Floats) -> None:
            self.ranges_n = rows[-1, -1], np.max(rows[:, -1])

    def sized(size: float) -> Recording:
        sample = made_up(duration_s=6.0)
        assert sample.force_n is not None
        return recording(sample.time_s, sample.position_m, size * sample.force_n)

    monkeypatch.setattr(published, "Network", Listening)
    networks = OfflineNetworks({"seal_a": sized(1000.0), "seal_b": sized(1e6), "other": sized(1.0)})
    assert instrument("seal_a") == instrument("seal_b") != instrument("other") == "other"
    assert max(networks.without("seal_a", 0.1)[0].ranges_n) < 10.0  # type: ignore[attr-defined]
    assert max(networks.without("other", 0.1)[0].ranges_n) > 1e5  # type: ignore[attr-defined]


def row(name: str, method: str, ratio: float, diverged_at_s: float | None = None) -> Row:
    return Row("", name, 0.3, method, ratio, ratio, None, diverged_at_s, None, 0.0)


def test_the_sign_test_counts_recordings_or_instruments() -> None:
    names = "seal_a", "seal_b", "seal_c", "x", "y"
    ours = [row(name, "forefeel", 0.5) for name in names]
    theirs = [row(name, "zoh", size) for name, size in zip(names, (1, 1, 0.4, 1, 0.4), strict=True)]
    assert sign_test(ours, theirs) == "3 of 5, p 1"
    assert sign_test(ours, theirs, instrument) == "2 of 3, p 1"
    assert sign_test(ours, [row(name, "zoh", 0.1, 4.0) for name in names]) == "5 of 5, p 0.062"
    assert sign_test(ours, ours) == "-"
