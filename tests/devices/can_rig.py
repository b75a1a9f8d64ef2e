"""Emulated CAN devices in threads of this process, and settings of drivers that reach them."""

import queue
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from typing import Protocol

import can

from forefeel.devices.canopen.settings import CanSettings
from forefeel.devices.cia402.emulator import Drive402
from forefeel.devices.cia402.settings import Cia402Settings
from forefeel.devices.cia404.emulator import Transducer404
from forefeel.devices.cia404.settings import Cia404Settings
from forefeel.slave.plant.presets import PRESETS
from forefeel.slave.plant.settings import StageSettings
from tests.waiting import PATIENCE_S

COUNTS_PER_M = 1e6
DRIVE, CELL = 5, 6
START_M = 0.01
_channels = count()


class Steps(Protocol):
    """Whatever lives by being stepped."""

    def step(self) -> None: ...


def new_channel() -> CanSettings:
    """A bus of its own within this process."""
    return CanSettings(interface="virtual", channel=f"test {next(_channels)}")


def virtual_bus(settings: CanSettings) -> can.BusABC:
    """A further participant of it."""
    return can.Bus(interface="virtual", channel=settings.channel)


def mechanics(start_m: float = START_M) -> StageSettings:
    """A stiff, quick drive without play."""
    preset = dict(PRESETS["catheter"]["stage"])
    preset.update(
        travel_lower_m=-0.005,
        travel_upper_m=0.125,
        start_m=start_m,
        bandwidth_hz=60.0,
        velocity_limit_m_s=0.5,
        acceleration_limit_m_s2=20.0,
        encoder_step_m=1e-6,
        backlash_width_m=0.0,
    )
    return StageSettings(**preset)


def stage_settings(bus: CanSettings, **changed: object) -> Cia402Settings:
    """Slow enough for a busy machine: 50 Hz."""
    values: dict[str, object] = {
        "driver": "cia402",
        "can": bus,
        "node_id": DRIVE,
        "counts_per_m": COUNTS_PER_M,
        "travel_m": (-0.002, 0.12),
        "max_velocity_m_s": 0.2,
        "sync_hz": 50,
        "heartbeat_s": 0.05,
        "following_error_m": 0.002,
        **changed,
    }
    return Cia402Settings.model_validate(values)


def cell_settings(bus: CanSettings, **changed: object) -> Cia404Settings:
    """At the drive's rate."""
    values: dict[str, object] = {
        "driver": "cia404",
        "can": bus,
        "node_id": CELL,
        "full_scale_n": 10.0,
        "rate_hz": 50,
        **changed,
    }
    return Cia404Settings.model_validate(values)


def drive_on(bus: can.BusABC, start_m: float = START_M) -> Drive402:
    return Drive402(bus, DRIVE, mechanics(start_m), COUNTS_PER_M, rate_hz=1000)


def cell_on(bus: can.BusABC, feel: Callable[[float], float] = lambda _: 1.25) -> Transducer404:
    return Transducer404(bus, CELL, feel)


class _Life:
    """Steps one in a thread; what it raises is kept, and ends it."""

    def __init__(self, one: Steps) -> None:
        self.broken: BaseException | None = None
        self._one, self._stopping = one, threading.Event()
        self._actions: queue.SimpleQueue[tuple[Callable[[], object], threading.Event]] = queue.SimpleQueue()
        self.thread = threading.Thread(target=self._run, name=type(one).__name__)

    def do(self, action: Callable[[], object]) -> None:
        """Between two steps, for what the stepping thread must not meet half done; waits for it."""
        done = threading.Event()
        self._actions.put((action, done))
        assert done.wait(PATIENCE_S)

    def end(self) -> None:
        self._stopping.set()
        self.thread.join()

    def _run(self) -> None:
        try:
            while not self._stopping.is_set():
                self._one.step()
                while not self._actions.empty():
                    action, done = self._actions.get()
                    action()
                    done.set()
        except BaseException as error:  # noqa: BLE001 - shown by the test
            self.broken = error


@contextmanager
def running(*living: Steps) -> Iterator[Callable[[Callable[[], object]], None]]:
    """Steps each in a thread of its own; yields what does something between two steps of the first."""
    lives = [_Life(one) for one in living]
    for life in lives:
        life.thread.start()
    try:
        yield lives[0].do
    finally:
        for life in lives:
            life.end()
        for broken in filter(None, (life.broken for life in lives)):
            raise broken
