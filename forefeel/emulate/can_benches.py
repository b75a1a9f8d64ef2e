"""Emulated CAN devices, each on a bus of its own process, and the hub that joins them."""

from contextlib import ExitStack
from pathlib import Path

import can

from forefeel.common.hardware.can_bus import open_bus
from forefeel.common.hardware.cia402 import NEGATIVE_SWITCH, POSITIVE_SWITCH
from forefeel.common.hardware.settings import CanSettings
from forefeel.emulate.benches import Surroundings, felt, moved
from forefeel.emulate.can_hub import CanHub
from forefeel.emulate.drive402 import Drive402
from forefeel.emulate.drive402_homing import SWITCH_M
from forefeel.emulate.transducer404 import Transducer404
from forefeel.emulate.wire import Faults
from forefeel.slave.load_cells.settings import Cia404Settings
from forefeel.slave.stages.settings import Cia402Settings


def drive(settings: Cia402Settings, around: Surroundings, leave: ExitStack) -> Drive402:
    """The drive of the world's stage, with the vessel in front of it; its limit switches beyond the travel,
    the one that it is homed to where the settings have it.
    """
    low_m, high_m = sorted(settings.sign * end_m for end_m in settings.travel_m)
    home_m, method = settings.sign * settings.homing.home_m, settings.homing.method
    negative_m = home_m if method == NEGATIVE_SWITCH and home_m < low_m else low_m - SWITCH_M
    positive_m = home_m if method == POSITIVE_SWITCH and home_m > high_m else high_m + SWITCH_M
    stage = around.world.stage.model_copy(
        update={
            "travel_lower_m": negative_m - SWITCH_M,
            "travel_upper_m": positive_m + SWITCH_M,
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


def hub(links: str, faults: Faults, seed: int, leave: ExitStack) -> CanHub:
    """As many adapters as paths with commas between them."""
    found = CanHub([Path(link) for link in links.split(",")], faults=faults, seed=seed)
    leave.callback(found.close)
    return found


def _bus(settings: CanSettings, leave: ExitStack) -> can.BusABC:
    bus = open_bus(settings)
    leave.callback(bus.shutdown)
    return bus
