"""The evaluation of a whole recording is the same physics as stepping through it, for every effect."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from forefeel.common.causes import base
from forefeel.common.causes.motion import Motion, MotionSample
from forefeel.common.causes.registry import OWN
from tests.unit.model_samples import effect, model

Array = NDArray[np.float64]

quick = settings(deadline=None, max_examples=40, derandomize=True)
seeds = st.integers(0, 2**32 - 1)


def assert_same(found: Array, expected: Array) -> None:
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


def random_motion(seed: int, n: int = 400) -> tuple[Array, Array, Array, Array]:
    """(t, x, v, a) at uneven stamps: strokes with holds at exactly zero velocity, x on both sides of 0."""
    random = np.random.default_rng(seed)
    t = random.uniform(0.0, 20.0) + np.cumsum(random.choice([1e-3, 1e-3, 2.5e-4, 7e-3, 0.05], n))
    v = np.repeat(random.normal(0.0, 0.05, n // 20), 20)
    v *= np.repeat(random.random(n // 20) < 0.7, 20)
    v += (v != 0.0) * random.normal(0.0, 2e-5, n)
    x = np.cumsum(v * np.diff(t, prepend=t[0]))
    x += random.uniform(-0.5, 0.5) * np.ptp(x)
    return t, x, v, np.gradient(v, t)


def forced(seed: int) -> Motion:
    """Random motion whose acceleration serves as the force at the jaws."""
    motion = random_motion(seed)
    return Motion.of(*motion, force=motion[3])


def random_effect(kind: type[base.Effect], seed: int) -> base.Effect:
    """Parameters over the decades of their bounds that matter for such a motion, near the defaults too."""
    random = np.random.default_rng(seed)
    values = {}
    for p in kind.parameters:
        typical = p.default if p.default > 0.0 else 1.0
        value = typical * 10.0 ** random.uniform(-1.5, 1.5)
        sign = -1.0 if p.lower < 0.0 and random.random() < 0.3 else 1.0
        values[p.name] = float(np.clip(sign * value, p.lower, p.upper))
    return kind(**values)


def steps_of(motion: Motion) -> list[MotionSample]:
    rows = np.stack((motion.t, motion.x, motion.v, motion.a, motion.dt), axis=1)
    samples = [MotionSample(*row) for row in rows.tolist()]
    for sample, force_n in zip(samples, np.broadcast_to(motion.force, motion.t.shape).tolist(), strict=True):
        sample.force = force_n
    return samples


def evaluated(effect: base.Effect, m: Any) -> tuple[Any, ...]:  # noqa: ANN401 - a sample or a motion
    """Whatever the effect makes of a sample or of a motion, whose position or acceleration is the force."""
    if isinstance(effect, base.ForceEffect):
        return effect.regressors(m)
    if isinstance(effect, base.MotionEffect):
        moved = effect.moved(m)
        return moved.x, moved.v, moved.a
    if isinstance(effect, base.ContactEffect):
        return effect.contact(m)
    if isinstance(effect, base.FactorEffect):
        return (effect.factor(m, m.a),)
    assert isinstance(effect, base.SensorEffect)
    return (effect.reading(m, m.x),)


def stepwise(effect: base.Effect, motion: Motion) -> Array:
    return np.array([evaluated(effect, sample) for sample in steps_of(motion)])


def whole(effect: base.Effect, motion: Motion) -> Array:
    columns = np.broadcast_arrays(*evaluated(effect, motion), motion.t)[:-1]
    return np.stack(columns, axis=1).astype(np.float64, casting="no")


@pytest.mark.parametrize("name", sorted(OWN))
@quick
@given(seeds)
def test_a_whole_recording_is_what_its_steps_are(name: str, seed: int) -> None:
    effect, motion = random_effect(OWN[name], seed), forced(seed)
    assert_same(whole(effect, motion), stepwise(effect, motion))


@pytest.mark.parametrize("name", sorted(OWN))
def test_a_whole_recording_neither_sees_nor_changes_the_state(name: str) -> None:
    effect = random_effect(OWN[name], 1)
    motion, other = (forced(seed) for seed in (2, 3))
    first = whole(effect, motion)
    effect.reset()
    expected = stepwise(effect, other)
    effect.reset()
    for part in (slice(0, 150), slice(150, None)):
        np.testing.assert_array_equal(whole(effect, motion), first)
        np.testing.assert_array_equal(stepwise(effect, other[part]), expected[part])


@pytest.mark.parametrize("name", sorted(OWN))
@pytest.mark.parametrize("n", [0, 1, 2])
def test_hardly_any_samples_are_no_special_case(name: str, n: int) -> None:
    effect = random_effect(OWN[name], 6)
    assert len(whole(effect, Motion.of(*random_motion(7))[:n])) == n


FORCES = sorted(name for name, kind in OWN.items() if issubclass(kind, base.ForceEffect))


@pytest.mark.parametrize("name", FORCES)
@quick
@given(seeds)
def test_the_span_holds_the_effect_and_leads_back_to_it(name: str, seed: int) -> None:
    effect, motion = random_effect(OWN[name], seed), Motion.of(*random_motion(seed))
    assert isinstance(effect, base.ForceEffect)
    force_n = effect.columns(motion) @ np.array(effect.linear_values)
    span = effect.span(motion)
    scale = np.linalg.norm(span, axis=0)
    scale[scale == 0.0] = 1.0
    found = np.linalg.lstsq(span / scale, force_n, rcond=None)[0] / scale
    size = float(np.max(np.abs(force_n), initial=1e-12))
    np.testing.assert_allclose(span @ found, force_n, rtol=0.0, atol=1e-7 * size)
    again = type(effect)(**effect.from_span(found)) if _within(effect, effect.from_span(found)) else None
    if again is not None:
        repeated = again.columns(motion) @ np.array(again.linear_values)
        np.testing.assert_allclose(repeated, force_n, rtol=0.0, atol=1e-6 * size)


def _within(effect: base.ForceEffect, values: dict[str, float]) -> bool:
    """Not determined by this motion, a coefficient may leave the bounds."""
    return all(p.lower <= values[p.name] <= p.upper for p in effect.parameters)


MEMORY = [
    effect("backlash", width_m=0.0005),
    effect("contact_loss", contact_position_m=0.001),
    effect("mass_damper_spring"),
    effect("stress_relaxation", time_constant_s=0.3),
    effect("presliding_hysteresis", "wall", stiffness_n_m=40.0),
    effect("coulomb_friction", forward_n=0.2, backward_n=0.1),
    effect("stress_relaxation", "shaft"),
    effect("bias", force_n=0.03),
    effect("sensor_lag", time_constant_s=0.02),
    effect("sensor_saturation", limit_n=0.3),
    effect("gripper_slip", holding_n=0.1, slipped_m=0.001),
    effect("capstan", wrap_rad=0.3),
    effect("buckling", euler_n_m2=1e-4, free_length_m=0.03),
]


@quick
@given(seeds, st.sets(st.integers(0, len(MEMORY) - 1), min_size=1))
def test_a_composition_at_once_is_what_its_steps_are(seed: int, places: set[int]) -> None:
    composed, motion = model(*(MEMORY[i] for i in sorted(places))), random_motion(seed)
    steps = np.stack((*motion, np.diff(motion[0], prepend=motion[0][0])), axis=1).tolist()
    regressed, stepped, at_once = composed.runtime(), composed.runtime(), composed.runtime()
    phi = np.array([regressed.regressors(*at) for at in steps]).reshape(len(steps), -1)
    assert_same(at_once.columns(Motion.of(*motion)), phi)
    force_n = np.array([stepped.step(*at) for at in steps])
    assert_same(at_once.forces_n(Motion.of(*motion)), force_n)


def test_linear_sensors_may_be_taken_of_each_column() -> None:
    runtime = model(*MEMORY[2:5], effect("sensor_lag", time_constant_s=0.02)).runtime()
    motion = random_motion(8)
    values = np.array(runtime.linear_values)
    sensed = runtime.columns(Motion.of(*motion), sensed=True) @ values
    assert_same(sensed, runtime.forces_n(Motion.of(*motion)))
    assert not np.allclose(sensed, runtime.columns(Motion.of(*motion)) @ values, atol=1e-6)
