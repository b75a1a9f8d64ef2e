"""A contact that an engine of others computes, on its own time grid.

The engine stands behind an entry point of the group `forefeel.worlds` and is named as a device is:

    simulation: {world: {driver: mujoco, model: wire.xml, drive: push, force: cell}}

It is told where the carriage is, and says with what force the instrument answers. Stage, encoder, load cell,
fixture and what is hidden stay those of `forefeel.slave.plant`.
"""

from collections.abc import Sequence
from math import ceil
from typing import ClassVar, Protocol

from forefeel.common.causes.motion import Columns
from forefeel.common.errors import ConfigurationError, DeviceError, InputError
from forefeel.common.hardware.driver import DriverSettings, Slot, driver_of, imported

Point = tuple[float, float, float]
_ROUNDING_S = 1e-9


class WorldDriverSettings(DriverSettings):
    slot: ClassVar[Slot] = "world"
    hardware: ClassVar[bool] = False


class World(Protocol):
    """The instrument in an engine; its `Driver.make` is called with the settings alone.

    Attributes:
        period_s: length of a step.
    """

    @property
    def period_s(self) -> float: ...

    def step(self, position_m: float, velocity_m_s: float) -> float:
        """Goes on by `period_s`, to where the carriage is then; returns the force in N that resists
        insertion. The first position is the carriage's at the start. Any exception is a fault of the device.
        """
        ...

    def shape_m(self) -> Sequence[Point]:
        """Centre line of the instrument, the tip last; empty where nothing is to be drawn. Called between two
        steps, in their thread.
        """
        ...


class Added(Protocol):
    """Our own effects beside those of the engine, as in `ContactRuntime`."""

    instrument_m: float

    def follow(self, further: Columns) -> None: ...

    def step(self, t: float, x: float, v: float, a: float, dt: float) -> float: ...

    def step_unheld(self, t: float, x: float, v: float, a: float, dt: float) -> float: ...

    def reset_contact(self) -> None: ...


class ForeignContact:
    """The force of the engine, held between its steps, plus that of the `added` effects."""

    def __init__(self, settings: WorldDriverSettings, added: Added) -> None:
        """ConfigurationError: the engine is not installed, or can not be made of the settings."""
        self._name, self._added = settings.driver, added
        try:
            make = imported(driver_of("world", settings).driver.make)
        except ImportError as error:
            needs = "MuJoCo comes with pip install 'forefeel[worlds]'"
            raise ConfigurationError(f"world {self._name}: {error}; {needs}") from error
        try:
            self.world: World = make(settings)
        except InputError:
            raise
        except Exception as error:
            why = " ".join(str(error).split()) or type(error).__name__
            raise ConfigurationError(f"world {self._name}: can not be made of its settings: {why}") from error
        self._due_s: float | None = None
        self._force_n = 0.0
        self.instrument_m = 0.0

    def follow(self, further: Columns) -> None:
        self._added.follow(further)

    def step(self, t: float, x: float, v: float, a: float, dt: float) -> float:
        """Steps the added effects by dt to time t, and the engine if its next step is due; returns the sum of
        both forces in N, the engine's held between its steps. Raises DeviceError where the engine fails.
        """
        if self._due_s is None or t > self._due_s - _ROUNDING_S:
            try:
                self._force_n = self.world.step(x, v)
            except Exception as error:
                raise DeviceError(f"world {self._name}: {error or type(error).__name__}") from error
            period_s, due_s = self.world.period_s, t if self._due_s is None else self._due_s
            self._due_s = due_s + period_s * ceil((t - due_s + 2.0 * _ROUNDING_S) / period_s)
        added_n = self._added.step(t, x, v, a, dt)
        self.instrument_m = x
        return self._force_n + added_n

    def step_unheld(self, t: float, x: float, v: float, a: float, dt: float) -> float:
        """Lets the instrument lie where it was let go: the engine's time stands still."""
        return self._added.step_unheld(t, x, v, a, dt)

    def reset_contact(self) -> None:
        self._added.reset_contact()
