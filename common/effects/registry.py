"""Effects by name: our own, and those that installed distributions add.

A third party adds an effect by an entry point of the group `forefeel.effects` whose name is the effect's
name; it is loaded, and checked, when a model first asks for that name. Our own names can not be taken over.
docs/examples/effect-package is one.
"""

from functools import cache
from importlib.metadata import entry_points

import numpy as np

from forefeel.common.effects.asymmetric_damping import AsymmetricDamping
from forefeel.common.effects.backlash import Backlash
from forefeel.common.effects.base import Effect
from forefeel.common.effects.bias import Bias
from forefeel.common.effects.contact_loss import ContactLoss
from forefeel.common.effects.coulomb_friction import CoulombFriction
from forefeel.common.effects.exponential_wall import ExponentialWall
from forefeel.common.effects.hunt_crossley_damping import HuntCrossleyDamping
from forefeel.common.effects.mains_hum import MainsHum
from forefeel.common.effects.mass_damper_spring import MassDamperSpring
from forefeel.common.effects.plugin import load_plugin
from forefeel.common.effects.position_dependent_friction import PositionDependentFriction
from forefeel.common.effects.presliding_hysteresis import PreslidingHysteresis
from forefeel.common.effects.pulsation import Pulsation
from forefeel.common.effects.quadratic_drag import QuadraticDrag
from forefeel.common.effects.runtime import ContactRuntime
from forefeel.common.effects.sensor_drift import SensorDrift
from forefeel.common.effects.sensor_lag import SensorLag
from forefeel.common.effects.sensor_quantisation import SensorQuantisation
from forefeel.common.effects.sensor_saturation import SensorSaturation
from forefeel.common.effects.sensor_spikes import SensorSpikes
from forefeel.common.effects.stiffening import Stiffening
from forefeel.common.effects.stiffness_change import StiffnessChange
from forefeel.common.effects.stress_relaxation import StressRelaxation
from forefeel.common.effects.stribeck_friction import StribeckFriction
from forefeel.common.effects.time_delay import TimeDelay
from forefeel.common.effects.unmodelled_resonance import UnmodelledResonance

ENTRY_POINT_GROUP = "forefeel.effects"

OWN: dict[str, type[Effect]] = {
    effect.name: effect
    for effect in (
        AsymmetricDamping, Backlash, Bias, ContactLoss, CoulombFriction, ExponentialWall,
        HuntCrossleyDamping, MainsHum, MassDamperSpring, PositionDependentFriction,
        PreslidingHysteresis, Pulsation, QuadraticDrag, SensorDrift, SensorLag, SensorQuantisation,
        SensorSaturation, SensorSpikes, Stiffening, StiffnessChange, StressRelaxation,
        StribeckFriction, TimeDelay, UnmodelledResonance,
    )
}  # fmt: skip


def effect_names() -> tuple[str, ...]:
    """Every name that `effect_class` knows, sorted; nothing is loaded."""
    return tuple(sorted({*OWN, *(point.name for point in entry_points(group=ENTRY_POINT_GROUP))}))


@cache
def effect_class(name: str) -> type[Effect]:
    """The effect of that name.

    Raises:
        ValueError: no such effect, or an entry point that is not usable; one line.
    """
    if name in OWN:
        return OWN[name]
    points = tuple(entry_points(group=ENTRY_POINT_GROUP, name=name))
    if points:
        return load_plugin(points)
    raise ValueError(f"unknown effect {name!r}, expected one of {', '.join(effect_names())}")


def compile_kernels() -> None:
    """Runs every loop over a recording once, so that no later process waits for the compiler."""
    t = np.arange(3.0) * 1e-3
    for kind in OWN.values():
        values = {p.name: min(max(p.default, p.lower, 1e-3), p.upper) for p in kind.parameters}
        ContactRuntime([(kind(**values), None)]).forces_n(t, t, t, t)
