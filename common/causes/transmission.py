"""Play between stage and instrument, with the mass on either side."""

from collections.abc import Sequence
from itertools import product
from math import nan
from typing import ClassVar

import numpy as np

from forefeel.common.causes.base import MotionEffect, Parameter
from forefeel.common.causes.candidate import (
    Candidate,
    Entry,
    Extent,
    Fitted,
    Shape,
    Transmission,
    Values,
    entry,
    log_grid,
)
from forefeel.common.causes.motion import Gap, Kinematics
from forefeel.common.causes.wall import MassDamperSpring


def widths(extent: Extent) -> list[Shape]:
    """Widths in m that are tried, .005 to .6 of the stroke."""
    return log_grid(0.005 * extent.stroke_m, 0.6 * extent.stroke_m, 9)


class Backlash(MotionEffect):
    """Play operator of full width w = width_m: the instrument rests while the stage crosses the gap.

    `y(t + dt) = min(max(y(t), x - w/2), x + w/2)`; without history the stage stands in the middle of the gap.
    """

    name = "backlash"
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter("width_m", "m", 0.0, 0.0, 1e6, linear=False),)
    picture = "reversal"
    kin = "play"
    reference = "Krasnosel'skii and Pokrovskii, Systems with Hysteresis, 1989, the play operator"
    fingerprint = "after each reversal the force stands still over a constant width of the position"
    words = "play between stage and instrument"
    remedy = "tighten what clamps the instrument to the stage"
    equation: ClassVar[tuple[str, ...]] = ("x behind a play of {width_m} m",)
    candidates: ClassVar[Sequence[Candidate]] = (
        Transmission(shapes=("width_m",), grid=widths, sizes=("width_m",)),
    )
    gap = Gap()

    def moved(self, m: Kinematics) -> Kinematics:
        """Instrument's motion: the stage's velocity and acceleration while it pushes or pulls, else rest."""
        half_m = 0.5 * self.values["width_m"]
        if half_m == 0.0:
            return m
        y, carried = m.through(self.gap, m.x, half_m, nan, 1.0)
        return m.along(y, m.v * carried, m.a * carried)


HELD_S = 1e9
"""Settling of an instrument that friction holds where it is: longer than any recording."""
_SHARES = 0.02, 0.06, 0.2  # of the stroke: widths that are tried first; chosen
_RESTS = tuple(np.linspace(0.1, 0.9, 7).tolist())  # of the range of positions; chosen
_SETTLINGS_S = 0.03, 0.2  # s, damping over stiffness of tissue and vessels; chosen


def _loose_shapes(extent: Extent) -> list[Shape]:
    low_m, range_m = extent.low_m, extent.range_m
    points = product(_SHARES, _RESTS, _SETTLINGS_S)
    return [(width * extent.stroke_m, low_m + rest * range_m, settling) for width, rest, settling in points]


def _named(fitted: Fitted) -> Values:
    width_m, rest_m, settling_s = fitted.shape
    (behind_kg,) = map(float, fitted.coefficients)
    return {"width_m": width_m, "rest_position_m": rest_m, "settling_s": settling_s, "behind_kg": behind_kg}


def _with_mass_behind(fitted: Fitted) -> list[Entry]:
    values = _named(fitted)
    mass = {"mass_kg": values["behind_kg"], "damping_n_s_m": 0.0, "stiffness_n_m": 0.0}
    return [entry(Play, values), entry(MassDamperSpring, mass)]


class Play(Backlash):
    """Backlash of the contact alone: the mass moves with the stage, only what resists is behind the gap.

    Within the gap friction holds the instrument, or, with a settling_s below HELD_S, the tissue's spring
    takes it to rest_position_m: `y' = -(y - rest) / settling`, settling = damping / stiffness. It then lies
    against the side from which it is pressed, and no force is felt while it crosses; a part of the mass may
    be behind the gap.

    In a model.yaml the mass on the stage is a `mass_damper_spring` of its own at the site `sensor`.
    """

    name = "play"
    parameters = (
        *Backlash.parameters,
        Parameter("rest_position_m", "m", 0.0, -1e6, 1e6, linear=False),
        Parameter("settling_s", "s", HELD_S, 0.0, HELD_S, linear=False),
    )
    fingerprint = (
        "after each reversal the force of the contact stands still over a constant width of the position, "
        "while the mass is felt at once; or it is zero over that width where its sign changes"
    )
    words = "play between the moving mass and the contact"
    remedy = "tighten what holds the instrument behind the moving mass"
    equation = (
        "x but for the mass behind a play of {width_m} m, loose about {rest_position_m} m",
        "x but for the mass behind a play of {width_m} m",
    )
    candidates = (
        Transmission(shapes=("width_m",), grid=widths, sizes=("width_m",), mass_site="sensor"),
        Transmission(
            form="loose", shapes=("width_m", "rest_position_m", "settling_s"), sizes=("width_m",),
            coefficients=("behind_kg",), signs=(1,), grid=_loose_shapes, logarithmic=False,
            mass_site="sensor", naming=_named, making=_with_mass_behind, costly=True, picture="position",
        ),
    )  # fmt: skip

    def moved(self, m: Kinematics) -> Kinematics:
        """Returns the instrument's motion for the stage's motion m; at a side of the gap it is carried.

        Within the gap it rests, or with a settling_s below `HELD_S` settles to rest_position_m. With a width
        of 0 it is the stage's motion. Advances the gap's state at a `MotionSample`.
        """
        width_m, rest_m, settling_s = (self.values[p.name] for p in self.parameters)
        if settling_s >= HELD_S or width_m == 0.0:
            return super().moved(m)
        least_s = max(settling_s, 1e-12)
        y, carried = m.through(self.gap, m.x, 0.5 * width_m, rest_m, m.exp(-m.dt / least_s))
        rate = (1.0 - carried) * (y - rest_m) / least_s if settling_s > 0.0 else 0.0 * y
        return m.along(y, carried * m.v - rate, carried * m.a + rate / least_s)
