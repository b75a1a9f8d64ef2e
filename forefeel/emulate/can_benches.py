"""Emulated CAN devices, each on a bus of its own process, and the hub that joins them."""

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import can

from common.hardware.can_bus import open_bus
from common.hardware.settings import CanSettings
from forefeel.emulate.benches import Surroundings, felt, moved
from forefeel.emulate.can_hub import CanHub
from forefeel.emulate.drive402 import Drive402
from forefeel.emulate.transducer404 import Transducer404
from forefeel.emulate.wire import Faults
from slave.load_cells.settings import Cia404Settings
from slave.stages.settings import Cia402Settings

Step = Callable[[], None]
Counts = Callable[[], dict[str, int]]


def drive(settings: Cia402Settings, around: Surroundings, leave: ExitStack) -> Drive402:
    """The drive of the world's stage, with the vessel in front of it."""
    low_m, high_m = sorted(settings.sign * end_m for end_m in settings.travel_m)
    stage = around.world.stage.model_copy(
        update={
            "travel_lower_m": low_m,
            "travel_upper_m": high_m,
            "start_m": settings.sign * around.world.stage.start_m,
            "velocity_limit_m_s": 2.0 * settings.max_velocity_m_s,
        }
    )
    hook = moved(around, settings.sign, leave)
    return Drive402(_bus(settings.can, leave), settings.node_id, stage, settings.counts_per_m, hook)


def transducer(settings: Cia404Settings, around: Surroundings, leave: ExitStack) -> Transducer404:
    """The force transducer on the stage."""
    feel = felt(around, settings.sign, leave)
    return Transducer404(_bus(settings.can, leave), settings.node_id, feel, settings.full_scale_n)


def hub(links: str, faults: Faults, seed: int, leave: ExitStack) -> tuple[Step, Counts]:
    """As many adapters as paths with commas between them."""
    found = CanHub([Path(link) for link in links.split(",")], faults=faults, seed=seed)
    leave.callback(found.close)
    return found.step, found.counts


def _bus(settings: CanSettings, leave: ExitStack) -> can.BusABC:
    bus = open_bus(settings)
    leave.callback(bus.shutdown)
    return bus
