"""Forces that follow another column of a recording: of a second axis, another force, a temperature.

A form of a diagnosis has the column of its slot: the first, second, ... of those that were recorded beside.
"""

from dataclasses import dataclass
from functools import partial
from math import pi

import numpy as np

from forefeel.common.causes.base import ForceEffect, Parameter
from forefeel.common.causes.candidate import Entry, Extent, Fitted, Form, Shape, log_grid
from forefeel.common.causes.motion import Increment, Kinematics, MotionGrid, PrandtlElement, Value
from forefeel.common.causes.numerics import Array

_SLOTS = 4
_LEAST_ARC_RAD, _MOST_ARC_RAD = pi / 2.0, 8.0 * pi  # of a turn: over less a sine is a spring and a constant
_AXES = frozenset({"rad", "m"})


def _always(slot: int, extent: Extent) -> list[Shape]:
    return [()] if slot < len(extent.further) else []


def _turned(slot: int, extent: Extent) -> list[Shape]:
    angle = _always(slot, extent) and extent.further[slot].unit == "rad"
    return [()] if angle and extent.further[slot].extent > _LEAST_ARC_RAD else []


def _radii(slot: int, extent: Extent) -> list[Shape]:
    """Radii in m at which an arc in m is a turn that shows a sine."""
    if not _always(slot, extent) or extent.further[slot].unit != "m":
        return []
    arc_m = extent.further[slot].extent
    return log_grid(arc_m / _MOST_ARC_RAD, arc_m / _LEAST_ARC_RAD, 16)


def _breakaways(slot: int, extent: Extent) -> list[Shape]:
    if not _always(slot, extent) or extent.further[slot].unit not in _AXES:
        return []
    return log_grid(1e-3 * extent.further[slot].extent, 0.05 * extent.further[slot].extent, 4)


@dataclass(frozen=True, kw_only=True, eq=False)
class OfColumn(Form):
    """Form of the column in a slot; `mix` says which of the effect's terms it has."""

    slot: int

    def columns(self, motion: MotionGrid, shape: Shape) -> list[Array]:
        """Columns of the terms in `mix`, for the column in the slot; zeros where nothing stands there."""
        effect, names = self.effect(shape), list(motion.further)
        effect.column = names[self.slot] if self.slot < len(names) else ""
        return list(np.array(self.mix) @ effect.columns(motion).T)

    def entries(self, fitted: Fitted) -> list[Entry]:
        return [{**entry, "column": fitted.column} for entry in super().entries(fitted)]


def _forms(slot: int) -> tuple[OfColumn, ...]:
    """Forms in which a diagnosis fits the column of a slot: linear, a sine of an angle or of an arc of
    searched radius, friction with a searched breakaway, and this with a linear part.
    """
    number, share, rub = slot + 1, (0, 0, 1, 0), (0, 0, 0, 1)
    form = partial(OfColumn, slot=slot, least_score=20.0)
    turned = partial(
        form, coefficients=("sine_n", "cosine_n"), mix=((1, 0, 0, 0), (0, 1, 0, 0)), signs=(0, 0)
    )
    rubbed = partial(form, shapes=("breakaway",), grid=partial(_breakaways, slot))
    return (
        form(form=f"linear{number}", coefficients=("slope",), mix=(share,), signs=(0,),
             grid=partial(_always, slot)),
        turned(form=f"angle{number}", grid=partial(_turned, slot)),
        turned(form=f"arc{number}", shapes=("radius_m",), grid=partial(_radii, slot)),
        rubbed(form=f"friction{number}", coefficients=("friction_n",), mix=(rub,), signs=(0,)),
        rubbed(form=f"both{number}", plainer=f"friction{number}", coefficients=("slope", "friction_n"),
               mix=(share, rub), signs=(0, 0)),
    )  # fmt: skip


class WithColumn(ForceEffect):
    """`f = sine_n sin(c / r) + cosine_n cos(c / r) + slope c + friction_n s`, c the value of `column`.

    The weight of an eccentric holder (c an angle and r = 1, or an arc and r = radius_m), and cross-talk: a
    spring, a share of another force, a dry friction with ds = dc / breakaway within -1 to 1. slope and
    breakaway have the column's unit. Without the column it is 0.
    """

    name = "with_column"
    site = "sensor"
    parameters = (
        Parameter("sine_n", "N", 0.0, -1e4, 1e4),
        Parameter("cosine_n", "N", 0.0, -1e4, 1e4),
        Parameter("slope", "", 0.0, -1e9, 1e9),
        Parameter("friction_n", "N", 0.0, -1e4, 1e4),
        Parameter("radius_m", "m", 1.0, 1e-9, 1e6, linear=False),
        Parameter("breakaway", "", 1e-6, 1e-12, 1e6, linear=False),
    )
    reference = "Spong, Hutchinson and Vidyasagar, Robot Modeling and Control, 2006, section 7.3"
    fingerprint = "what is left follows a column that was recorded beside, or the direction in which it moves"
    words = "a force that goes with {column}"
    remedy = "balance what turns with it, part the cell from it, or feed it forward by that column"
    picture = "time"
    equation = (
        "{sine_n} sin(c/{radius_m}) + {cosine_n} cos(c/{radius_m})",
        "{sine_n} sin(c) + {cosine_n} cos(c)",
        "{slope} c + {friction_n} s; ds = dc/{breakaway} within -1 to 1",
        "{friction_n} s; ds = dc/{breakaway} within -1 to 1",
        "{slope} c",
    )
    increment, element = Increment(), PrandtlElement()
    column = ""
    candidates = tuple(form for slot in range(_SLOTS) for form in _forms(slot))

    def regressors(self, m: Kinematics) -> tuple[Value, ...]:
        """Returns sin(c / r), cos(c / r), c and the friction's state s, -1 to 1, which it advances. c is the
        value of `column`; without that column all are 0.
        """
        c = m.further.get(self.column)
        if c is None:
            return 0.0, 0.0, 0.0, 0.0
        turned = c / self.values["radius_m"]
        moved = m.through(self.increment, c) / self.values["breakaway"]
        return m.sin(turned), m.cos(turned), c, m.through(self.element, moved)
