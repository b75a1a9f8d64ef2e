"""Composition of effects into one contact: the plant's force, the predictor's regressors."""

from collections import Counter
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from itertools import pairwise
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
from forefeel.common.causes.motion import Columns, Motion, MotionSample
from forefeel.common.causes.numerics import Array

SITES: tuple[Site, ...] = "sensor", "shaft", "wall"
"""Sites in the order of a runtime's regressors."""


class WallMotion:
    """An instrument's motion as the effects of the wall see it: in contact only, one piece per contact.

    Without a contact effect the wall is touched throughout.
    """

    def __init__(self, contact: ContactEffect | None, motion: Motion) -> None:
        depth, touching = (motion.x, np.ones(len(motion.t))) if contact is None else contact.contact(motion)
        self._rows = np.flatnonzero(touching)
        starts = np.flatnonzero(np.diff(self._rows, prepend=-2) > 1).tolist()
        contacts = tuple(slice(*ends) for ends in pairwise([*starts, len(self._rows)]))
        self._motion = replace(replace(motion, x=depth)[self._rows], pieces=contacts or (slice(None),))
        self._n = len(motion.t)

    def columns(self, effect: ForceEffect) -> Array:
        """Columns of an effect, 0 out of contact; shape (n, its linear parameters)."""
        columns = np.zeros((self._n, len(effect.linear_names)))
        columns[self._rows] = effect.columns(self._motion)
        return columns


class ContactRuntime:
    """Steps a composition of effects. Per step, in this order:

    1. motion effects turn the stage's motion into the instrument's, in the order given; those `by_force` by
       the sum of 4 after the step before;
    2. `contact_loss`, where there is one, decides on contact and gives the depth that the wall's effects see
       as their position; out of contact they give 0, and their state is reset;
    3. force effects are summed: those in the sensor see the stage's motion, the others the instrument's;
    4. factor effects multiply the forces of shaft and wall, in the order given, by the sum of these forces;
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
        self._readings = [effect.reading for effect in self._sensors]
        self._motions = [effect for effect in self._effects if isinstance(effect, MotionEffect)]
        self._moved = [effect.moved for effect in self._motions]
        self._by_force = any(effect.by_force for effect in self._motions)
        self._factors = [effect for effect in self._effects if isinstance(effect, FactorEffect)]
        contacts = [effect for effect in self._effects if isinstance(effect, ContactEffect)]
        if len(contacts) > 1:
            raise ValueError(f"effects: {len(contacts)} contact effects, expected at most one")
        self._contact = contacts[0] if contacts else None
        self._in_contact = self._contact.contact if self._contact else None
        self._touching = False
        self._sample = MotionSample(0.0, 0.0, 0.0, 0.0, 0.0)
        self.instrument_m = 0.0
        self._compose_forces(effects)

    def _compose_forces(self, effects: Sequence[tuple[Effect, Site | None]]) -> None:
        """Sorts the force effects by site and labels a second one of equal name `effect-2`; ignores other
        kinds. Sets `linear_names`, `linear_values`, the effects and their `regressors` by site, and the zeros
        that stand for wall and shaft without contact or grip.
        """
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

    def follow(self, further: Columns) -> None:
        """Sets the columns beside the motion, by name, for the steps from now on."""
        self._sample.further = further

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> list[float]:
        """Advances all but the sensor effects by dt to time t; returns phi_i of `linear_names`.

        phi_i of the wall are 0 out of contact, whose loss resets the wall's effects; factor effects multiply
        those of shaft and wall. Sets `instrument_m`. t, dt in s; x m, v m/s, a m/s^2: the stage's motion at
        the end of the step. To be called once per step, or `step` in its place.
        """
        phi: list[float] = []
        m = self._sample
        m.t, m.x, m.v, m.a, m.dt = t, x, v, a, dt
        for compute in self._at_sensor:
            phi += compute(m)
        for moved in self._moved:
            m = moved(m)
        self.instrument_m = m.x
        first = len(phi)
        for compute in self._at_shaft:
            phi += compute(m)
        x, touching = m.x, 1.0
        if self._in_contact is not None:
            m.x, touching = self._in_contact(m)
        if touching:
            self._touching = True
            for compute in self._at_wall:
                phi += compute(m)
        else:
            self._lose_contact()
            phi += self._no_wall
        m.x = x
        if self._factors:
            force_n, factor = sum(map(mul, self.linear_values[first:], phi[first:])), 1.0
            for effect in self._factors:
                factor *= effect.factor(m, factor * force_n)
            phi[first:] = [factor * value for value in phi[first:]]
        if self._by_force:
            m.force = sum(map(mul, self.linear_values[first:], phi[first:]))
        return phi

    def regressors_unheld(self, t: float, x: float, v: float, a: float, dt: float) -> list[float]:
        """Returns phi_i of `linear_names` while nothing grips the instrument: 0 but for forces in the sensor.

        Advances these effects by dt to time t; the others keep their states.
        """
        phi: list[float] = []
        m = self._sample
        m.t, m.x, m.v, m.a, m.dt = t, x, v, a, dt
        for compute in self._at_sensor:
            phi += compute(m)
        phi += self._unheld
        return phi

    def step(self, t: float, x: float, v: float, a: float, dt: float) -> float:
        """Advances every effect by dt to time t and returns the sensed force in N; see `regressors`."""
        force_n: float = sum(map(mul, self.linear_values, self.regressors(t, x, v, a, dt)))
        for reading in self._readings:
            force_n = reading(self._sample, force_n)
        return force_n

    def step_unheld(self, t: float, x: float, v: float, a: float, dt: float) -> float:
        """Sensed force in N while nothing grips the instrument; advances the sensor's effects alone."""
        force_n: float = sum(map(mul, self.linear_values, self.regressors_unheld(t, x, v, a, dt)))
        for reading in self._readings:
            force_n = reading(self._sample, force_n)
        return force_n

    def columns(self, motion: Motion, *, sensed: bool = False) -> Array:
        """Returns phi_i at every stamp of a recorded motion, from rest at the first; shape (n, linear names).

        Equals `regressors` step by step, but changes no state. `sensed`: passes each column through the
        linear sensor effects, such as a lag.
        """
        phi = self._stepped(motion) if self._by_force else self._at_once(motion)
        for sensor in self._sensors if sensed else ():
            if sensor.linear:
                phi = np.stack([sensor.reading(motion, column) for column in phi.T], axis=1)
        return phi

    def _at_once(self, stage: Motion) -> Array:
        """Columns of `linear_names` over a whole motion, shape (n, names); no effect may be `by_force`."""
        m = stage
        for moved in self._moved:
            m = moved(m)
        wall = WallMotion(self._contact, m)
        acting = [*(effect.columns(m) for effect in self._shaft), *(wall.columns(e) for e in self._wall)]
        at_tip = np.concatenate([np.empty((len(stage.t), 0)), *acting], axis=1)
        if self._factors:
            force_n = at_tip @ np.array(self.linear_values[len(self.linear_values) - at_tip.shape[1] :])
            for effect in self._factors:
                factor = effect.factor(m, force_n)
                at_tip, force_n = at_tip * factor[:, None], force_n * factor
        return np.concatenate([*(effect.columns(stage) for effect in self._sensor), at_tip], axis=1)

    def _stepped(self, stage: Motion) -> Array:
        """Columns by `regressors` at each step of a copy, from rest in each piece: for effects `by_force`."""
        other, rows = deepcopy(self), list[list[float]]()
        for piece in stage.pieces:
            other.reset()
            for i in range(*piece.indices(len(stage.t))):
                other.follow({name: float(values[i]) for name, values in stage.further.items()})
                step = (float(values[i]) for values in (stage.t, stage.x, stage.v, stage.a, stage.dt))
                rows.append(other.regressors(*step))
        return np.array(rows).reshape(len(stage.t), -1)

    def forces_n(self, motion: Motion) -> Array:
        """`step` at every stamp of a recorded motion, from rest at the first; shape (n,)."""
        force_n = np.asarray(self.columns(motion) @ np.array(self.linear_values))
        for reading in self._readings:
            force_n = reading(motion, force_n)
        return force_n

    def revalue(self, values: Sequence[Mapping[str, float]]) -> None:
        """Changes the values of the effects, in the order given to the class, and keeps the states."""
        for effect, given in zip(self._effects, values, strict=True):
            if any(effect.values.get(name) != value for name, value in given.items()):
                effect.revalue(**given)
        self.linear_values = tuple(value for effect in self._forces for value in effect.linear_values)

    def reset_contact(self) -> None:
        """Resets all effects but those on the reading, as after a new grip."""
        for effect in self._effects:
            if not isinstance(effect, SensorEffect):
                effect.reset()
        self._touching, self._sample.force = False, 0.0

    def reset(self) -> None:
        self.reset_contact()
        for effect in self._sensors:
            effect.reset()

    def _lose_contact(self) -> None:
        if self._touching:
            for effect in self._wall:
                effect.reset()
            self._touching = False
