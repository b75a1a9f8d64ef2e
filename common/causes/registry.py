"""Effects by name: our own, and those that installed distributions add.

A third party adds an effect by an entry point of the group `forefeel.effects` whose name is the effect's
name; it is loaded, and checked, when a model first asks for that name. Our own names can not be taken over.
docs/examples/effect-package is one.
"""

from functools import cache
from importlib.metadata import entry_points

import numpy as np

from forefeel.common.causes.asymmetric_damping import AsymmetricDamping
from forefeel.common.causes.backlash import Backlash
from forefeel.common.causes.base import Effect
from forefeel.common.causes.bias import Bias
from forefeel.common.causes.capstan import Capstan
from forefeel.common.causes.contact_loss import ContactLoss
from forefeel.common.causes.coulomb_friction import CoulombFriction
from forefeel.common.causes.exponential_wall import ExponentialWall
from forefeel.common.causes.hunt_crossley_damping import HuntCrossleyDamping
from forefeel.common.causes.mains_hum import MainsHum
from forefeel.common.causes.mass_damper_spring import MassDamperSpring
from forefeel.common.causes.play import Play
from forefeel.common.causes.plugin import load_plugin
from forefeel.common.causes.position_dependent_friction import PositionDependentFriction
from forefeel.common.causes.position_map import PositionMap
from forefeel.common.causes.presliding_hysteresis import PreslidingHysteresis
from forefeel.common.causes.pulsation import Pulsation
from forefeel.common.causes.quadratic_drag import QuadraticDrag
from forefeel.common.causes.runtime import ContactRuntime
from forefeel.common.causes.sensor_drift import SensorDrift
from forefeel.common.causes.sensor_lag import SensorLag
from forefeel.common.causes.sensor_quantisation import SensorQuantisation
from forefeel.common.causes.sensor_saturation import SensorSaturation
from forefeel.common.causes.sensor_spikes import SensorSpikes
from forefeel.common.causes.stiffening import Stiffening
from forefeel.common.causes.stiffness_change import StiffnessChange
from forefeel.common.causes.stress_relaxation import StressRelaxation
from forefeel.common.causes.stribeck_friction import StribeckFriction
from forefeel.common.causes.time_delay import TimeDelay
from forefeel.common.causes.unmodelled_resonance import UnmodelledResonance

ENTRY_POINT_GROUP = "forefeel.effects"

OWN: dict[str, type[Effect]] = {
    effect.name: effect
    for effect in (
        AsymmetricDamping, Backlash, Bias, Capstan, ContactLoss, CoulombFriction, ExponentialWall,
        HuntCrossleyDamping, MainsHum, MassDamperSpring, Play, PositionDependentFriction, PositionMap,
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
