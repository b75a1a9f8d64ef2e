"""The simulated contact: what the instrument feels, what is switched on in a run, and the fixture."""

from math import inf

from forefeel.common.causes.base import SensorEffect
from forefeel.common.causes.model import ContactModel, at_conversion
from forefeel.common.causes.motion import Columns, MotionSample
from forefeel.common.causes.runtime import ContactRuntime
from forefeel.common.messages import Grip
from forefeel.slave.plant.foreign import ForeignContact
from forefeel.slave.plant.settings import HiddenSettings, WorldSettings


class SwitchedContact:
    """A `ContactRuntime` that becomes another at `from_s` of the world's time.

    Both are in motion from the start: what is switched on knows the motion so far, and the rest stays as it
    was.
    """

    def __init__(self, before: ContactRuntime, after: ContactRuntime, from_s: float) -> None:
        self._now, self._after, self._from_s = before, after, from_s
        self.instrument_m = 0.0

    def follow(self, further: Columns) -> None:
        self._now.follow(further)
        self._after.follow(further)

    def step(self, t: float, x: float, v: float, a: float, dt: float) -> float:
        """Steps both contacts by `dt` to time `t`, after the switch only the second; returns the force in N
        of the one that holds then, and takes over its `instrument_m`. x, v, a: motion at the end of the step.
        """
        self._switch(t)
        force_n = self._now.step(t, x, v, a, dt)
        if self._after is not self._now:
            self._after.step(t, x, v, a, dt)
        self.instrument_m = self._now.instrument_m
        return force_n

    def step_unheld(self, t: float, x: float, v: float, a: float, dt: float) -> float:
        self._switch(t)
        force_n = self._now.step_unheld(t, x, v, a, dt)
        if self._after is not self._now:
            self._after.step_unheld(t, x, v, a, dt)
        return force_n

    def reset_contact(self) -> None:
        self._now.reset_contact()
        self._after.reset_contact()

    def _switch(self, t: float) -> None:
        if t >= self._from_s:
            self._now, self._from_s = self._after, inf


class Converter:
    """Effects that change readings: those of the contact from the start, hidden ones from `from_s` on."""

    def __init__(self, effects: list[SensorEffect], hidden: list[SensorEffect], from_s: float) -> None:
        self._effects = [*((0.0, effect) for effect in effects), *((from_s, effect) for effect in hidden)]

    def sense(self, t: float, force_n: float, dt: float) -> float:
        """The reading in N of a force at time t in s, dt after the last."""
        for from_s, effect in self._effects:
            if t >= from_s:
                force_n = effect.reading(MotionSample(t, 0.0, 0.0, 0.0, dt), force_n)
        return force_n


PlantContact = ContactRuntime | SwitchedContact | ForeignContact


def plant_contact(world: WorldSettings) -> tuple[PlantContact, Converter]:
    """Builds the world's contact and the converter of its readings, which has those of its effects that act
    at a conversion.
    """
    contact, converter = _own_contact(world.contact, world.hidden)
    return (contact if world.world is None else ForeignContact(world.world, contact)), converter


def _own_contact(
    contact: ContactModel, hidden: HiddenSettings | None
) -> tuple[ContactRuntime | SwitchedContact, Converter]:
    """Builds contact and converter from our own effects; those of `hidden`, if any, act from `from_s` on."""
    continuous, converts = at_conversion(contact)
    if hidden is None:
        return continuous.runtime(), Converter(converts, [], 0.0)
    added, later = at_conversion(hidden.effects)
    both = ContactModel(contact.name, continuous.effects + added.effects)
    switched = SwitchedContact(continuous.runtime(), both.runtime(), hidden.from_s)
    return switched, Converter(converts, later, hidden.from_s)


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
        """Closes or opens at once; returns the grip as applied."""
        if grip is Grip.CLOSED and self.grip is Grip.OPEN:
            self._offset_m = self.inserted_m - carriage_m
            self._contact.reset_contact()
        self.grip = grip
        return grip

    def step(self, t: float, x: float, v: float, a: float, dt: float) -> float:
        """Steps the contact by dt to time t, with the carriage's motion (x, v, a), and while closed updates
        `inserted_m`; returns the force on the load cell in N.
        """
        if self.grip is Grip.OPEN:
            return self._contact.step_unheld(t, x, v, a, dt)
        force_n = self._contact.step(t, x + self._offset_m, v, a, dt)
        self.inserted_m = self._contact.instrument_m
        return force_n
