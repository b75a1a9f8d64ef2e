"""Finds the driver that a YAML file names.

A driver is one `Driver` behind an entry point. The group of the entry point says which port it serves, and
its name is what stands at `driver:` in the YAML file:

    [project.entry-points."forefeel.load_cells"]
    iio = "forefeel_iio:DRIVER"

Only the module of the driver that is named is imported: a slave without CAN devices never imports the CAN
libraries.
"""

from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any, ClassVar, Literal, NamedTuple, get_args

from pydantic import BeforeValidator, ValidationInfo
from pydantic_core import PydanticKnownError

from forefeel.common.config import Settings
from forefeel.common.errors import ConfigurationError

Slot = Literal["stage", "gripper", "load_cell", "handle", "world"]
SLOTS: tuple[Slot, ...] = get_args(Slot)
_GROUPS: dict[Slot, str] = {slot: f"forefeel.{slot}s" for slot in SLOTS}


class DriverSettings(Settings):
    """Base of the section of the YAML file that a driver reads.

    `slot`: of the port; its base class has it. `hardware`: whether a device stands behind the driver; an
    emulated one counts.
    """

    slot: ClassVar[Slot]
    hardware: ClassVar[bool] = True
    driver: str


@dataclass(frozen=True, slots=True)
class Driver:
    """Description of a driver by its package. Places are `module:name` and are imported when they are used.

    `make` is called with (settings, clock) and returns the port of the driver's slot; a driver of the
    simulated world (`in_world`) is called with (settings, world), a world with its settings alone. `homing`:
    called with (settings, clock), calibrates a stage (`forefeel.slave.stage.Homing`). `emulator`: a
    `forefeel.devices.emulation.bench.Emulation`.
    """

    settings: type[DriverSettings]
    make: str
    what: str
    in_world: bool = False
    homing: str | None = None
    emulator: str | None = None


class InstalledDriver(NamedTuple):
    """A driver with the distribution that it comes from."""

    slot: Slot
    name: str
    distribution: str
    version: str
    driver: Driver

    @property
    def origin(self) -> str:
        """Name, distribution and version, such as `zaber_ascii (forefeel 0.1.0)`."""
        return f"{self.name} ({self.distribution} {self.version})"

    def make(self, settings: DriverSettings, around: object) -> Any:  # noqa: ANN401 - the port of its slot
        """The device, not opened yet; `around`: the clock or the world, see `Driver`."""
        return imported(self.driver.make)(settings, around)

    def make_homing(self, settings: DriverSettings, clock: object) -> Any:  # noqa: ANN401 - a Homing
        """The `forefeel.slave.stage.Homing` that calibrates the stage, not entered yet.

        Raises:
            ConfigurationError: the driver offers none.
        """
        if self.driver.homing is None:
            raise ConfigurationError(
                f"{self.slot}.driver = {self.name!r}: can not be homed from here; use its maker's tools"
            )
        return imported(self.driver.homing)(settings, clock)


def imported(place: str) -> Any:  # noqa: ANN401 - whatever stands there
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)


@cache
def installed_driver(slot: Slot, name: str) -> InstalledDriver:
    """Driver of that name for that slot, imported at the first call.

    Raises:
        KeyError: no installed distribution has one.
        ConfigurationError: it can not be imported, or is no driver.
    """
    return _loaded(slot, _entries(slot)[name])


def installed_drivers(slot: Slot) -> list[InstalledDriver]:
    """Every driver of a slot, by name; all of them are imported."""
    return [installed_driver(slot, name) for name in sorted(_entries(slot))]


def every_driver() -> list[InstalledDriver]:
    return [driver for slot in SLOTS for driver in installed_drivers(slot)]


def driver_of(slot: Slot, settings: DriverSettings) -> InstalledDriver:
    return installed_driver(slot, settings.driver)


def driver_settings(slot: Slot, optional: bool = False) -> BeforeValidator:
    """Makes a validator of pydantic that turns a section of a YAML file into the settings of the driver that
    it names; None passes if `optional`.
    """

    def read(data: object, info: ValidationInfo) -> object:
        """Validates a section by the settings of the driver that it names; DriverSettings, and None if
        `optional`, pass unchanged. Raises ValueError: no mapping, or a driver that can not be imported;
        PydanticKnownError: none named, or not installed for the `slot` of the enclosing call.
        """
        if isinstance(data, DriverSettings) or (optional and data is None):
            return data
        if not isinstance(data, dict):
            raise ValueError("expected a mapping such as {driver: simulated}")
        if "driver" not in data:
            raise PydanticKnownError("union_tag_not_found", {"discriminator": "'driver'"})
        name = str(data["driver"]).encode(errors="replace").decode()  # pydantic takes no half characters
        try:
            installed = installed_driver(slot, name)
        except KeyError:
            known = ", ".join(map(repr, sorted(_entries(slot))))
            expected = {"discriminator": "'driver'", "tag": name, "expected_tags": known}
            raise PydanticKnownError("union_tag_invalid", expected) from None
        except ConfigurationError as error:
            raise ValueError(str(error)) from error
        return installed.driver.settings.model_validate(data, context=info.context)

    return BeforeValidator(read)


def _entries(slot: Slot) -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in _installed().select(group=_GROUPS[slot])}


_installed = cache(entry_points)  # each look takes 4 ms, and what is installed stays while a process lives


def _loaded(slot: Slot, entry: EntryPoint) -> InstalledDriver:
    """Imports the driver of an entry point; returns it with its distribution's name and version. Raises
    ConfigurationError where it can not be imported, is no Driver, or its settings are of another name.
    """
    try:
        driver = entry.load()
    except (ImportError, AttributeError) as error:
        raise ConfigurationError(f"driver {entry.name!r} ({entry.value}): {error}") from error
    if not isinstance(driver, Driver):
        raise ConfigurationError(
            f"driver {entry.name!r} ({entry.value}): expected a Driver, not {driver!r:.40}"
        )
    if entry.name not in get_args(driver.settings.model_fields["driver"].annotation):
        raise ConfigurationError(
            f"driver {entry.name!r} ({entry.value}): its settings have no `driver: Literal[{entry.name!r}]`"
        )
    distribution = entry.dist
    about = (distribution.name, distribution.version) if distribution else ("", "")
    return InstalledDriver(slot, entry.name, *about, driver)
