"""What a model of a diagnosis is worth across a delay: the stretch that is replayed, and what counts."""

import numpy as np
import pytest

from forefeel.common.causes.model import ContactModel
from forefeel.common.causes.motion import Motion
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis import prediction

RATE_HZ = 100.0
SPRING = {"mass_kg": 0.0, "damping_n_s_m": 1.0, "stiffness_n_m": 100.0}
EFFECTS = [
    {"effect": "mass_damper_spring", "parameters": SPRING},
    {"effect": "presliding_hysteresis", "parameters": {"force_n": 0.8, "stiffness_n_m": 4e3}},
]
MODEL = ContactModel.from_mapping({"schema": "forefeel.model/1", "name": "rubs", "effects": EFFECTS})


def test_run_that_begins_at_rest_is_judged_where_it_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(prediction, "_LONGEST", 600)
    t = np.arange(0.0, 16.0, 1.0 / RATE_HZ)
    moving_s = np.maximum(t - 10.0, 0.0)
    x = 0.005 * (1.0 - np.cos(2.0 * np.pi * 0.4 * moving_s))
    v = np.gradient(x, t)
    force_n = MODEL.runtime().forces_n(Motion.of(t, x, v, np.gradient(v, t)))
    force_n = force_n + 0.002 * np.random.default_rng(0).standard_normal(len(t))
    across = prediction.across_delay(Recording("late", t, x, force_n, "late"), MODEL)

    assert (across.from_s, across.to_s) == pytest.approx((10.0, 16.0), abs=0.1)
    assert across.after_n < 0.7 * across.before_n < 0.7 * across.zoh_n
