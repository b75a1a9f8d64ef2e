"""What holds for every effect and every motion."""

from math import isfinite
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from forefeel.common.causes.base import ForceEffect
from forefeel.common.causes.model import ContactModel
from forefeel.common.causes.motion import MotionSample
from forefeel.common.causes.registry import OWN
from forefeel.common.causes.runtime import ContactRuntime
from forefeel.common.causes.transmission import Backlash
from tests.unit.model_samples import effect, model

FORCES = sorted(name for name, kind in OWN.items() if issubclass(kind, ForceEffect))
NO_SENSOR = [*FORCES, "backlash"]
LATER = ["sensor_spikes", "time_delay"]

quick = settings(deadline=None, max_examples=60, derandomize=True)
velocities = st.floats(-0.1, 0.1, allow_subnormal=False)
paths = st.lists(st.tuples(velocities, st.integers(1, 30)), min_size=1, max_size=8)


@st.composite
def effects(draw: st.DrawFn, names: list[str]) -> dict[str, Any]:
    """One effect with moderate parameters within its bounds."""
    name = draw(st.sampled_from(names))
    values = {
        p.name: draw(st.floats(max(p.lower, 1e-4), min(p.upper, max(p.lower, 5.0)), allow_subnormal=False))
        for p in OWN[name].parameters
    }
    column = {"column": "roll"} if name == "with_column" else {}
    return {**effect(name, **values), **column}


@st.composite
def models(draw: st.DrawFn, names: list[str]) -> ContactModel:
    listed = draw(st.lists(effects(names), min_size=1, max_size=6))
    if draw(st.booleans()):
        listed.append(effect("contact_loss", contact_position_m=0.001))
    return model(*listed)


def motion(path: list[tuple[float, int]], dt: float = 1e-3) -> list[tuple[float, float, float, float, float]]:
    """(t, x, v, a, dt) of a path of constant velocities, each for some steps."""
    steps: list[tuple[float, float, float, float, float]] = []
    x = before = 0.0
    for v, count in path:
        for _ in range(count):
            x += v * dt
            steps.append(((len(steps) + 1) * dt, x, v, (v - before) / dt, dt))
            before = v
    return steps


def forces(runtime: ContactRuntime, path: list[tuple[float, int]]) -> list[float]:
    return [runtime.step(*at) for at in motion(path)]


@quick
@given(models(NO_SENSOR), paths)
def test_the_force_is_linear_in_the_linear_parameters(
    model: ContactModel, path: list[tuple[float, int]]
) -> None:
    stepped, regressed = model.runtime(), model.runtime()
    assert len(stepped.linear_names) == len(set(stepped.linear_names)) == len(stepped.linear_values)
    for at in motion(path):
        phi = regressed.regressors(*at)
        dot = sum(theta * p for theta, p in zip(regressed.linear_values, phi, strict=True))
        assert stepped.step(*at) == pytest.approx(dot, rel=1e-12, abs=1e-12)


@quick
@given(effects([name for name in FORCES if name != "presliding_hysteresis"]), paths)
def test_twice_the_linear_parameters_is_twice_the_force(
    effect: dict[str, Any], path: list[tuple[float, int]]
) -> None:
    kind, values = OWN[effect["effect"]], effect["parameters"]
    linear = {p.name for p in kind.parameters if p.linear}
    single = kind(**values)
    double = kind(**{name: value * (2.0 if name in linear else 1.0) for name, value in values.items()})
    once, twice = ContactRuntime([(single, None)]), ContactRuntime([(double, None)])
    assert forces(twice, path) == pytest.approx([2.0 * force_n for force_n in forces(once, path)], rel=1e-12)


@quick
@given(models([*NO_SENSOR, "sensor_lag", "sensor_saturation", "sensor_quantisation", *LATER]), paths)
def test_a_reset_runtime_repeats_a_fresh_one(model: ContactModel, path: list[tuple[float, int]]) -> None:
    runtime = model.runtime()
    first = forces(runtime, path)
    assert all(isfinite(force) for force in first)
    runtime.reset()
    assert forces(runtime, path) == first


@quick
@given(models(sorted(set(OWN) - {"contact_loss"})))
def test_a_model_survives_its_mapping(model: ContactModel) -> None:
    assert ContactModel.from_mapping(model.to_mapping()) == model


@quick
@given(paths, st.floats(0.0, 0.01))
def test_the_instrument_stays_within_the_play(path: list[tuple[float, int]], width_m: float) -> None:
    effect = Backlash(width_m=width_m)
    for t, x, v, a, dt in motion(path):
        moved = effect.moved(MotionSample(t, x, v, a, dt))
        assert abs(moved.x - x) <= width_m / 2 + 1e-12
        assert moved.v in (0.0, v)
