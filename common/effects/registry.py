"""Effects by name: our own, and those that installed distributions add.

A third party adds an effect by an entry point of the group `forefeel.effects` whose name is the effect's
name; it is loaded, and checked, when a model first asks for that name. Our own names can not be taken over.
docs/examples/effect-package is one.
"""

from functools import cache
from importlib.metadata import entry_points

import numpy as np

from common.effects.asymmetric_damping import AsymmetricDamping
from common.effects.backlash import Backlash
from common.effects.base import Effect
from common.effects.bias import Bias
from common.effects.contact_loss import ContactLoss
from common.effects.coulomb_friction import CoulombFriction
from common.effects.exponential_wall import ExponentialWall
from common.effects.hunt_crossley_damping import HuntCrossleyDamping
from common.effects.mains_hum import MainsHum
from common.effects.mass_damper_spring import MassDamperSpring
from common.effects.plugin import load_plugin
from common.effects.position_dependent_friction import PositionDependentFriction
from common.effects.presliding_hysteresis import PreslidingHysteresis
from common.effects.pulsation import Pulsation
from common.effects.quadratic_drag import QuadraticDrag
from common.effects.runtime import ContactRuntime
from common.effects.sensor_drift import SensorDrift
from common.effects.sensor_lag import SensorLag
from common.effects.sensor_quantisation import SensorQuantisation
from common.effects.sensor_saturation import SensorSaturation
from common.effects.sensor_spikes import SensorSpikes
from common.effects.stiffening import Stiffening
from common.effects.stiffness_change import StiffnessChange
from common.effects.stress_relaxation import StressRelaxation
from common.effects.stribeck_friction import StribeckFriction
from common.effects.time_delay import TimeDelay
from common.effects.unmodelled_resonance import UnmodelledResonance

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
