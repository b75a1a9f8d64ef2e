"""Effects by name: our own, and those that installed distributions add.

A third party adds an effect by an entry point of the group `forefeel.effects` whose name is the effect's
name. When a model first names it, it is loaded, and tried before a loop uses it. Our own names can not be
overridden. Example: docs/examples/effect-package.
"""

from collections.abc import Iterator, Sequence
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from inspect import isabstract
from math import isfinite
from typing import get_args

import numpy as np

from forefeel.common.causes import (
    capstan,
    column,
    damping,
    friction,
    gripper,
    periodic,
    sensor,
    transmission,
    unmodelled_resonance,
    wall,
)
from forefeel.common.causes.base import (
    ContactEffect,
    Effect,
    FactorEffect,
    ForceEffect,
    MotionEffect,
    Parameter,
    SensorEffect,
    Site,
)
from forefeel.common.causes.motion import Motion
from forefeel.common.causes.runtime import ContactRuntime

ENTRY_POINT_GROUP = "forefeel.effects"

OWN: dict[str, type[Effect]] = {
    effect.name: effect
    for effect in (
        damping.AsymmetricDamping, transmission.Backlash, sensor.Bias, gripper.Buckling, capstan.Capstan,
        wall.ContactLoss, friction.CoulombFriction, wall.ExponentialWall, periodic.GravityLoad,
        gripper.GripperSlip, damping.HuntCrossleyDamping,
        periodic.MainsHum, wall.MassDamperSpring, transmission.Play, friction.PositionDependentFriction,
        periodic.PositionMap, friction.PreslidingHysteresis, periodic.Pulsation, damping.QuadraticDrag,
        sensor.SensorDrift, sensor.SensorLag, sensor.SensorQuantisation, sensor.SensorSaturation,
        sensor.SensorSpikes, wall.Stiffening, wall.StiffnessChange, wall.StressRelaxation,
        friction.StribeckFriction, sensor.TimeDelay, unmodelled_resonance.UnmodelledResonance,
        column.WithColumn, periodic.VaryingPulsation, wall.YieldingWall, wall.Prolapse,
    )
}  # fmt: skip


def effect_names() -> tuple[str, ...]:
    """Names of our own and of installed effects, sorted; loads nothing."""
    return tuple(sorted({*OWN, *(point.name for point in entry_points(group=ENTRY_POINT_GROUP))}))


@cache
def effect_class(name: str) -> type[Effect]:
    """Returns the class of the effect of that name; loads and tries an installed one at the first call.

    Raises:
        ValueError: no such effect, or an entry point that is not usable; one line.
    """
    if name in OWN:
        return OWN[name]
    points = tuple(entry_points(group=ENTRY_POINT_GROUP, name=name))
    if points:
        return load_plugin(points)
    raise ValueError(f"unknown effect {name!r}, expected one of {', '.join(effect_names())}")


_KINDS = (ForceEffect, MotionEffect, FactorEffect, ContactEffect, SensorEffect)
_TRIAL_STEP_S = 1e-3  # s, time and step of the trial calls: one period at 1 kHz


def load_plugin(points: Sequence[EntryPoint]) -> type[Effect]:
    """Loads the effect class of an entry point, checks its attributes, runs it for some steps and returns it.

    Args:
        points: all entry points of one name.

    Raises:
        ValueError: more than one, not loadable, no effect of that name, or one that fails when it is tried at
            its defaults; one line that names the entry point.
    """
    point = points[0]
    where = f"entry point {point.group}:{point.name} = {point.value}"
    if len(points) > 1:
        values = " and ".join(sorted(other.value for other in points))
        raise ValueError(f"entry point {point.group}:{point.name}: {values}, expected one of that name")
    try:
        loaded = point.load()
    except Exception as error:
        raise ValueError(f"{where}: can not be loaded, {_line(error)}") from error
    if not (isinstance(loaded, type) and issubclass(loaded, _KINDS)):
        expected = ", ".join(kind.__name__ for kind in _KINDS)
        raise ValueError(f"{where}: expected a class of forefeel.common.causes.base: {expected}")
    for flaw in _flaws(loaded, point.name):
        raise ValueError(f"{where}: {flaw}")
    try:
        _try(loaded)
    except Exception as error:
        raise ValueError(f"{where}: fails at its defaults, {_line(error)}") from error
    return loaded


def _flaws(kind: type[Effect], name: str) -> Iterator[str]:
    """Yields a text on each flaw of an effect class, the gravest first: another name than `name`, abstract
    methods left, wrong parameters or bounds, a force without a site. Nothing for a sound one.
    """
    if getattr(kind, "name", None) != name:
        yield f"expected an effect named {name}, its name is {getattr(kind, 'name', None)!r}"
    if isabstract(kind):
        yield f"lacks {', '.join(sorted(kind.__abstractmethods__))}"
    parameters = getattr(kind, "parameters", None)
    if not (isinstance(parameters, tuple) and all(isinstance(p, Parameter) for p in parameters)):
        yield "expected parameters to be a tuple of Parameter"
        return
    for p in parameters:
        if not (p.lower <= p.default <= p.upper and isfinite(p.lower) and isfinite(p.upper)):
            yield f"{p.name}: expected finite bounds around its default {p.default!r}"
    if issubclass(kind, ForceEffect) and getattr(kind, "site", None) not in get_args(Site):
        yield f"expected a site, one of {', '.join(get_args(Site))}"


def _try(kind: type[Effect]) -> None:
    """Runs an effect at its defaults beside a mass, damper and spring: three steps, and a recording.

    Raises:
        Exception: any error of the effect, or a ValueError on a result that is not finite or of wrong length.
    """
    runtime = ContactRuntime([(wall.MassDamperSpring(), None), (kind(), None)])
    for x, v, a in ((0.01, 0.02, 0.5), (0.005, -0.02, -0.5), (0.0, 0.0, 0.0)):
        phi = runtime.regressors(_TRIAL_STEP_S, x, v, a, _TRIAL_STEP_S)
        values, count = (*phi, runtime.step(_TRIAL_STEP_S, x, v, a, _TRIAL_STEP_S)), len(runtime.linear_names)
        if len(phi) != count or not all(map(isfinite, values)):
            raise ValueError(f"{values} beside mass, damper, spring; expected {count} regressors and a force")
    t = np.arange(3.0) * _TRIAL_STEP_S
    runtime.forces_n(Motion.of(t, t, t, t))  # fails if an equation applies `if` to a value


def _line(error: BaseException) -> str:
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
