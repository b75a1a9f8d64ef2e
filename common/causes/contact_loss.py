"""Unilateral contact: nothing is felt of the wall before it is reached."""

from dataclasses import replace

import numpy as np

from forefeel.common.causes import kinks
from forefeel.common.causes.base import ContactEffect, Parameter
from forefeel.common.causes.candidate import Extent, MotionGrid, Shape, Transmission
from forefeel.common.causes.offline import Array


def _beyond(motion: MotionGrid, shape: Shape) -> MotionGrid:
    """The motion as depth beyond the contact position; nothing before it."""
    (contact_m,) = shape
    instants = np.asarray(motion.x > contact_m, dtype=np.float64)
    touching = kinks.beyond(motion.x, contact_m) if motion.decimated else instants
    return replace(motion, x=np.maximum(motion.x - contact_m, 0.0), touching=touching)


def _pushing(motion: MotionGrid, shape: Shape) -> MotionGrid:
    """As `_beyond`, and nothing where spring and damper together would pull."""
    contact_m, release_s = shape
    depth = motion.x - contact_m
    touching = kinks.beyond(depth, 0.0) * kinks.beyond(depth + release_s * motion.v, 0.0)
    return replace(motion, x=np.maximum(depth, 0.0) * touching, touching=touching)


def _places(extent: Extent) -> list[Shape]:
    """Finer where the stroke ends: a contact that is lost there is lost for a moment only."""
    shares = (0.015, 0.035, *np.linspace(0.06, 0.85, 15))
    return [(extent.low_m + float(share) * extent.range_m,) for share in shares]


def _releases(extent: Extent) -> list[Shape]:
    return [(contact_m, release_s) for (contact_m,) in _places(extent)[::2] for release_s in _RELEASES_S]


_RELEASES_S = 0.02, 0.06, 0.2  # s, damping over stiffness of tissue and vessels; chosen


class ContactLoss(ContactEffect):
    """Contact beyond `contact_position_m`; the wall's effects see the depth d beyond it as their position.

    A wall pushes and does not pull: contact is also lost while `d + release_s x' <= 0`, with release_s the
    wall's damping over its stiffness. With 0 it is lost by the position alone.
    """

    name = "contact_loss"
    parameters = (
        Parameter("contact_position_m", "m", 0.0, -1e3, 1e3, linear=False),
        Parameter("release_s", "s", 0.0, 0.0, 1e3, linear=False),
    )
    reference = "Signorini's unilateral contact condition"
    fingerprint = "no force on one side of a position, a kink there, the model's force on the other side"
    words = "contact that begins at a certain position only"
    equation = (
        "x from the contact at {contact_position_m} m on, while x + {release_s} x' > {contact_position_m}",
        "x from the contact at {contact_position_m} m on",
    )
    candidates = (
        Transmission(
            shapes=("contact_position_m",), moved=_beyond, logarithmic=False, grid=_places, picture="contact"
        ),
        Transmission(
            form="carried", shapes=("contact_position_m",), moved=_beyond, logarithmic=False, grid=_places,
            mass_site="shaft", picture="contact",
        ),
        Transmission(
            form="pushing", shapes=("contact_position_m", "release_s"), moved=_pushing, logarithmic=False,
            grid=_releases, mass_site="shaft", costly=True, picture="contact",
        ),
    )  # fmt: skip

    def _configure(self) -> None:
        self._contact_m, self._release_s = self.values["contact_position_m"], self.values["release_s"]

    def penetration_m(self, x: float, v: float) -> float | None:
        """x - contact_position_m while the wall pushes."""
        depth = x - self._contact_m
        return depth if depth > 0.0 and depth + self._release_s * v > 0.0 else None

    def penetrations_m(self, x: Array, v: Array) -> Array:
        """x - contact_position_m while the wall pushes, else nan; shape (n,)."""
        depth = x - self._contact_m
        return np.where((depth > 0.0) & (depth + self._release_s * v > 0.0), depth, np.nan)
