"""Every driver there is: its settings, its class (imported when it is used), and what it is in words."""

from dataclasses import dataclass
from importlib import import_module
from typing import Any, Literal, get_args

from forefeel.common.clock import Clock
from forefeel.common.config import Settings
from forefeel.common.errors import ConfigurationError
from forefeel.master.settings import (
    CoilSettings,
    MultiSineSettings,
    OperatorSettings,
    RecordingSettings,
    SineSettings,
)
from forefeel.slave.load_cells.settings import (
    AsciiLineSettings,
    BotaSettings,
    Cia404Settings,
    RecordedLoadCellDriver,
    SimulatedLoadCellDriver,
)
from forefeel.slave.settings import GripperDriver
from forefeel.slave.stages.port import Homing
from forefeel.slave.stages.settings import Cia402Settings, SimulatedStageDriver, ZaberSettings

Slot = Literal["stage", "load_cell", "gripper", "handle"]


@dataclass(frozen=True, slots=True)
class Driver:
    """One driver. `place`: module and class, made of (settings, clock); None: there is no hardware behind it,
    and the daemon alone makes it. `homing`: likewise, what calibrates a stage
    (`forefeel.slave.stages.port.Homing`).
    """

    slot: Slot
    settings: type[Settings]
    place: str | None
    what: str
    homing: str | None = None

    @property
    def name(self) -> str:
        """As it stands at `driver:` in the YAML file."""
        return str(get_args(self.settings.model_fields["driver"].annotation)[0])

    def make(self, settings: Settings, clock: Clock) -> Any:  # noqa: ANN401 - the port of its slot
        """The driver, not opened yet."""
        if self.place is None:
            raise ValueError(f"{self.name}: a driver without hardware")
        return imported(self.place)(settings, clock)

    def make_homing(self, settings: Settings, clock: Clock) -> Homing:
        """What calibrates the stage, not entered yet.

        Raises:
            ConfigurationError: the driver offers none.
        """
        if self.homing is None:
            raise ConfigurationError(
                f"stage.driver = {self.name!r}: can not be homed from here; use its maker's tools"
            )
        found: Homing = imported(self.homing)(settings, clock)
        return found


def imported(place: str) -> Any:  # noqa: ANN401 - whatever stands there
    """What `module:name` names."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)


DRIVERS: tuple[Driver, ...] = (
    Driver("stage", SimulatedStageDriver, None, "the stage of the simulated world"),
    Driver(
        "stage",
        ZaberSettings,
        "forefeel.slave.stages.zaber_ascii:ZaberStage",
        "Zaber stage, ASCII protocol, serial",
        "forefeel.slave.stages.zaber_homing:ZaberHoming",
    ),
    Driver(
        "stage",
        Cia402Settings,
        "forefeel.slave.stages.cia402:Cia402Stage",
        "CiA 402 drive, CANopen",
        "forefeel.slave.stages.cia402_homing:Cia402Homing",
    ),
    Driver("load_cell", SimulatedLoadCellDriver, None, "the load cell of the simulated world"),
    Driver("load_cell", RecordedLoadCellDriver, None, "the force of a recording"),
    Driver(
        "load_cell",
        BotaSettings,
        "forefeel.slave.load_cells.bota_serial:BotaSerialLoadCell",
        "Bota six-axis cell, binary frames, serial",
    ),
    Driver(
        "load_cell",
        AsciiLineSettings,
        "forefeel.slave.load_cells.ascii_line:AsciiLineLoadCell",
        "a number a line (Loadstar, HX711), serial",
    ),
    Driver(
        "load_cell",
        Cia404Settings,
        "forefeel.slave.load_cells.cia404:Cia404LoadCell",
        "CiA 404 force transducer, CANopen",
    ),
    Driver("gripper", GripperDriver, None, "the fixture of the simulated world"),
    Driver("handle", OperatorSettings, None, "a synthetic operator"),
    Driver("handle", RecordingSettings, None, "plays the motion of a recording"),
    Driver("handle", SineSettings, None, "a sine"),
    Driver("handle", MultiSineSettings, None, "several sines"),
    Driver(
        "handle",
        CoilSettings,
        "forefeel.master.handles.coil_serial:CoilHandle",
        "voice coil and encoder behind a microcontroller, serial",
    ),
)
