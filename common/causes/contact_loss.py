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


def _places(extent: Extent) -> list[Shape]:
    """Finer where the stroke ends: a contact that is lost there is lost for a moment only."""
    shares = (0.015, 0.035, *np.linspace(0.06, 0.85, 15))
    return [(extent.low_m + float(share) * (extent.high_m - extent.low_m),) for share in shares]


class ContactLoss(ContactEffect):
    """Contact beyond `contact_position_m`; the wall's effects see the depth beyond it as their position."""

    name = "contact_loss"
    parameters = (Parameter("contact_position_m", "m", 0.0, -1e3, 1e3, linear=False),)
    reference = "Signorini's unilateral contact condition"
    fingerprint = "no force on one side of a position, a kink there, the model's force on the other side"
    words = "contact that begins at a certain position only"
    equation = ("x from the contact at {contact_position_m} m on",)
    candidates = (
        Transmission(
            shapes=("contact_position_m",), moved=_beyond, logarithmic=False, grid=_places, picture="contact"
        ),
        Transmission(
            form="carried", shapes=("contact_position_m",), moved=_beyond, logarithmic=False, grid=_places,
            mass_site="shaft", picture="contact",
        ),
    )  # fmt: skip

    def _configure(self) -> None:
        self._contact_m = self.values["contact_position_m"]

    def penetration_m(self, x: float) -> float | None:
        """x - contact_position_m while positive."""
        return x - self._contact_m if x > self._contact_m else None

    def penetrations_m(self, x: Array) -> Array:
        """x - contact_position_m while positive, else nan; shape (n,)."""
        return np.where(x > self._contact_m, x - self._contact_m, np.nan)
