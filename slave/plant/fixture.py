"""The simulated fixture: what holds the instrument, and what the instrument feels in the vessel."""

from forefeel.common.messages import Grip
from forefeel.slave.plant.contact import PlantContact


class PlantFixture:
    """Closed, the instrument moves with the carriage; open, it stays and the load cell feels nothing of it.

    Each closing is a new contact (its memory is forgotten) at the inserted length that the last opening left.
    """

    def __init__(self, contact: PlantContact, inserted_m: float, carriage_m: float) -> None:
        self._contact = contact
        self._offset_m = inserted_m - carriage_m
        self.grip = Grip.CLOSED
        self.inserted_m = inserted_m

    def set(self, grip: Grip, carriage_m: float) -> Grip:
        """Closes or opens at once; the grip as applied."""
        if grip is Grip.CLOSED and self.grip is Grip.OPEN:
            self._offset_m = self.inserted_m - carriage_m
            self._contact.reset_contact()
        self.grip = grip
        return grip

    def step(self, t: float, x: float, v: float, a: float, dt: float) -> float:
        """The force on the load cell in N, given the carriage's motion (x, v, a) after dt at time t."""
        if self.grip is Grip.OPEN:
            return self._contact.step_unheld(t, x, v, a, dt)
        force_n = self._contact.step(t, x + self._offset_m, v, a, dt)
        self.inserted_m = self._contact.instrument_m
        return force_n
