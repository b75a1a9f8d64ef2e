"""Unilateral contact: nothing is felt of the wall before it is reached."""

import numpy as np

from forefeel.common.effects.base import ContactEffect, Parameter
from forefeel.common.effects.offline import Array


class ContactLoss(ContactEffect):
    """Contact beyond `contact_position_m`; the wall's effects see the depth beyond it as their position."""

    name = "contact_loss"
    parameters = (Parameter("contact_position_m", "m", 0.0, -1e3, 1e3, linear=False),)
    reference = "Signorini's unilateral contact condition"
    fingerprint = "no force on one side of a position, a kink there, the model's force on the other side"

    def _configure(self) -> None:
        self._contact_m = self.values["contact_position_m"]

    def penetration_m(self, x: float) -> float | None:
        """x - contact_position_m while positive."""
        return x - self._contact_m if x > self._contact_m else None

    def penetrations_m(self, x: Array) -> Array:
        """x - contact_position_m while positive, else nan; shape (n,)."""
        return np.where(x > self._contact_m, x - self._contact_m, np.nan)
