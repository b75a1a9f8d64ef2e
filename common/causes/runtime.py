"""Several effects composed into one contact: the plant's force, the predictor's regressors."""

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import pairwise
from math import prod
from operator import mul

import numpy as np

from forefeel.common.causes.base import (
    ContactEffect,
    Effect,
    FactorEffect,
    ForceEffect,
    MotionEffect,
    SensorEffect,
    Site,
)
from forefeel.common.causes.numerics import Array, intervals_s

SITES: tuple[Site, ...] = "sensor", "shaft", "wall"
"""In the order of a runtime's regressors."""


class WallMotion:
    """An instrument's motion as the effects of the wall see it: in contact only, and each contact by itself.

    Args:
        contact: what decides on contact; without it the wall is touched throughout.
        t, x, v, a, dt: as of `ForceEffect.columns`.
    """

    def __init__(
        self, contact: ContactEffect | None, t: Array, x: Array, v: Array, a: Array, dt: Array
    ) -> None:
        depth = x if contact is None else contact.penetrations_m(x, v)
        touching = np.ones(len(t), dtype=bool) if contact is None else ~np.isnan(depth)
        self._rows = np.flatnonzero(touching)
        self._motion = [each[self._rows] for each in (t, depth, v, a, dt)]
        starts = np.flatnonzero(np.diff(self._rows, prepend=-2) > 1).tolist()
        self._contacts = [slice(*ends) for ends in pairwise([*starts, len(self._rows)])]
        self._n = len(t)

    def columns(self, effect: ForceEffect) -> Array:
        """Those of an effect, 0 without contact; shape (n, its linear parameters)."""
        columns = np.zeros((self._n, len(effect.linear_names)))
        for part in self._contacts if effect.remembers else [slice(None)]:
            columns[self._rows[part]] = effect.columns(*(each[part] for each in self._motion))
        return columns


class ContactRuntime:
    """Steps a composition of effects. Per step, in this order:

    1. motion effects turn the stage's motion into the instrument's, in the order given;
    2. `contact_loss`, where there is one, decides on contact and gives the depth that the wall's effects see
       as their position; without contact they give nothing, and have forgotten their state;
    3. force effects are summed: those in the sensor see the stage's motion, the others the instrument's;
    4. factor effects multiply the forces of shaft and wall, by the sum of these forces;
    5. sensor effects turn the force into the reading, in the order given.

    `regressors` stops before 5: bias and drift are force effects in the sensor and take part, a lag does not.
    `columns` and `forces_n` are the same for a whole recording, see `forefeel.common.causes.base`.

    Args:
        effects: each effect, and where it acts when not at its own site.

    Raises:
        ValueError: more than one contact effect.

    Attributes:
        linear_names: `effect.parameter` of each regressor: effects in the sensor first, then shaft, wall. The
            second effect of equal name is called `effect-2`.
        linear_values: theta_i, in the same order.
        instrument_m: the instrument's position after the last step, behind the motion effects.
    """

    def __init__(self, effects: Sequence[tuple[Effect, Site | None]]) -> None:
        self._effects = [effect for effect, _ in effects]
        self._sensors = [effect for effect in self._effects if isinstance(effect, SensorEffect)]
        self._senses = [effect.sense for effect in self._sensors]
        self._motions = [effect for effect in self._effects if isinstance(effect, MotionEffect)]
        self._transforms = [effect.transform for effect in self._motions]
        self._factors = [effect for effect in self._effects if isinstance(effect, FactorEffect)]
        contacts = [effect for effect in self._effects if isinstance(effect, ContactEffect)]
        if len(contacts) > 1:
            raise ValueError(f"effects: {len(contacts)} contact effects, expected at most one")
        self._contact = contacts[0] if contacts else None
        self._penetration_m = self._contact.penetration_m if self._contact else None
        self._touching = False
        self.instrument_m = 0.0
        self._compose_forces(effects)

    def _compose_forces(self, effects: Sequence[tuple[Effect, Site | None]]) -> None:
        """Sorts the force effects by site and numbers those of equal name."""
        by_site: dict[Site, list[ForceEffect]] = {site: [] for site in SITES}
        labels: dict[ForceEffect, str] = {}
        count: Counter[str] = Counter()
        for effect, site in effects:
            if isinstance(effect, ForceEffect):
                by_site[site or effect.site].append(effect)
                count[effect.name] += 1
                number = "" if count[effect.name] == 1 else f"-{count[effect.name]}"
                labels[effect] = f"{effect.name}{number}"
        forces = [effect for site in by_site.values() for effect in site]
        self.linear_names = tuple(f"{labels[e]}.{name}" for e in forces for name in e.linear_names)
        self._forces = forces
        self.linear_values = tuple(value for effect in forces for value in effect.linear_values)
        self._sensor, self._shaft, self._wall = by_site.values()
        self._at_sensor, self._at_shaft, self._at_wall = (
            [effect.regressors for effect in site] for site in by_site.values()
        )
        shaft, wall = (sum(len(e.linear_names) for e in by_site[site]) for site in ("shaft", "wall"))
        self._no_wall, self._unheld = (0.0,) * wall, (0.0,) * (shaft + wall)

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> list[float]:
        """phi_i of `linear_names` after advancing the effects by dt to time t; 0 at the wall out of contact.

        t, dt in s; x m, v m/s, a m/s^2: the stage's motion at the end of the step.
        Call this or `step`, once per step.
        """
        phi: list[float] = []
        for compute in self._at_sensor:
            phi += compute(t, x, v, a, dt)
        for transform in self._transforms:
            x, v, a = transform(t, x, v, a, dt)
        self.instrument_m = x
        own = len(phi)
        for compute in self._at_shaft:
            phi += compute(t, x, v, a, dt)
        depth = x if self._penetration_m is None else self._penetration_m(x, v)
        if depth is None:
            self._lose_contact()
            phi += self._no_wall
        else:
            self._touching = True
            for compute in self._at_wall:
                phi += compute(t, depth, v, a, dt)
        if self._factors:
            force_n = sum(map(mul, self.linear_values[own:], phi[own:]))
            factor = prod(effect.factor(x, v, force_n) for effect in self._factors)
            phi[own:] = [factor * each for each in phi[own:]]
        return phi

    def regressors_unheld(self, t: float, x: float, v: float, a: float, dt: float) -> list[float]:
        """As `regressors` while the fixture does not hold the instrument: only the sensor's own act."""
        phi: list[float] = []
        for compute in self._at_sensor:
            phi += compute(t, x, v, a, dt)
        phi += self._unheld
        return phi

    def step(self, t: float, x: float, v: float, a: float, dt: float) -> float:
        """The force in N, as sensed, after advancing every effect by dt to time t; see `regressors`."""
        force_n: float = sum(map(mul, self.linear_values, self.regressors(t, x, v, a, dt)))
        for sense in self._senses:
            force_n = sense(t, force_n, dt)
        return force_n

    def step_unheld(self, t: float, x: float, v: float, a: float, dt: float) -> float:
        """As `step` while the fixture does not hold the instrument."""
        force_n: float = sum(map(mul, self.linear_values, self.regressors_unheld(t, x, v, a, dt)))
        for sense in self._senses:
            force_n = sense(t, force_n, dt)
        return force_n

    def columns(self, t: Array, x: Array, v: Array, a: Array, *, sensed: bool = False) -> Array:
        """`regressors` at every stamp of a recording, from rest at the first; shape (n, linear names).

        `sensed`: as the linear ones of the sensor effects, such as a lag, pass each of them on.
        """
        dt = intervals_s(t)
        blocks = [np.empty((len(t), 0)), *(e.columns(t, x, v, a, dt) for e in self._sensor)]
        for motion in self._motions:
            x, v, a = motion.path(t, x, v, a, dt)
        acting = [effect.columns(t, x, v, a, dt) for effect in self._shaft]
        wall = WallMotion(self._contact, t, x, v, a, dt)
        acting += [wall.columns(effect) for effect in self._wall]
        own = np.concatenate([np.empty((len(t), 0)), *acting], axis=1)
        if self._factors:
            force_n = own @ np.array(self.linear_values[len(self.linear_values) - own.shape[1] :])
            own = own * np.prod([each.factors(x, v, force_n) for each in self._factors], axis=0)[:, None]
        phi = np.concatenate([*blocks, own], axis=1)
        for sensor in self._sensors if sensed else ():
            if sensor.linear:
                phi = np.stack([sensor.readings(t, column, dt) for column in phi.T], axis=1)
        return phi

    def forces_n(self, t: Array, x: Array, v: Array, a: Array) -> Array:
        """`step` at every stamp of a recording, from rest at the first; shape (n,)."""
        force_n = np.asarray(self.columns(t, x, v, a) @ np.array(self.linear_values))
        dt = intervals_s(t)
        for sensor in self._sensors:
            force_n = sensor.readings(t, force_n, dt)
        return force_n

    def revalue(self, values: Sequence[Mapping[str, float]]) -> None:
        """Gives each effect, in the order that they came in, other values; the states stay."""
        for effect, given in zip(self._effects, values, strict=True):
            if any(effect.values.get(name) != value for name, value in given.items()):
                effect.revalue(**given)
        self.linear_values = tuple(value for effect in self._forces for value in effect.linear_values)

    def reset_contact(self) -> None:
        """Forgets the state of motion and contact, as after a new grip, but not that of the sensor."""
        for effect in self._effects:
            if not isinstance(effect, SensorEffect):
                effect.reset()
        self._touching = False

    def reset(self) -> None:
        self.reset_contact()
        for effect in self._sensors:
            effect.reset()

    def _lose_contact(self) -> None:
        if self._touching:
            for effect in self._wall:
                effect.reset()
            self._touching = False
