"""Round trip and CPU of the CAN drivers beside raw frames:
`python -m benchmarks.hardware_can`. Hub and devices run in processes of their own.
"""

import multiprocessing
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.context import SpawnProcess
from pathlib import Path

import can

from forefeel.common.clock import MonotonicClock
from forefeel.common.errors import DeviceError
from forefeel.common.runtime.realtime import prepare_process, prepare_thread
from forefeel.devices.canopen.bus import open_bus
from forefeel.devices.canopen.cia301 import HEARTBEAT, NMT, OPERATIONAL, START, SYNC
from forefeel.devices.canopen.hub import CanHub
from forefeel.devices.canopen.network import HOST_NODE, SharedNetwork, acquire, release
from forefeel.devices.cia402 import protocol as cia402
from forefeel.devices.cia402.driver import Cia402Stage, command_pdo, state_pdo
from forefeel.devices.cia402.emulator import Drive402, DriveModel
from forefeel.devices.cia402.settings import Cia402Settings
from forefeel.devices.cia404.driver import Cia404LoadCell
from forefeel.devices.cia404.emulator import Transducer404
from forefeel.devices.cia404.settings import Cia404Settings
from forefeel.devices.emulation.sensing import EmulatedSensor
from forefeel.devices.shared.conversation import Pacer
from forefeel.devices.shared.settings import CanSettings
from forefeel.slave.plant.settings import preset

_RATES_HZ = 250, 500  # Hz of SYNC: the default of `sync_hz`, and twice that
_LASTS_S, _PRIORITY = 10.0, 50  # s of each measurement, chosen; SCHED_FIFO as `realtime.priority` by default
_DRIVE_NODE, _CELL_NODE = 5, 6  # CANopen nodes, arbitrary
_COUNTS_PER_M = 1e6  # of the emulated drive: a count is a micrometre


def main() -> None:
    """Prints one line a figure."""
    print(_prepare())
    for rate_hz in _RATES_HZ:
        with _devices() as channel:
            _driver(channel, rate_hz)
            _raw(channel, rate_hz)


# --- the other processes ---


def _prepare() -> str:
    """As every daemon does; threads that begin later have the priority, too."""
    return f"{prepare_process()}, {prepare_thread(_PRIORITY)}"


def _hub(links: list[Path]) -> None:
    _prepare()
    hub = CanHub(links)
    while True:
        hub.step()


def _drive(link: Path) -> None:
    _prepare()
    device = Drive402(
        _bus(link), _DRIVE_NODE, DriveModel(preset("catheter").stage, _COUNTS_PER_M, rate_hz=1000)
    )
    while True:
        device.step()


def _cell(link: Path) -> None:
    _prepare()
    device = Transducer404(_bus(link), _CELL_NODE, EmulatedSensor(lambda t_s: 0.5, 1000.0))
    while True:
        device.step()


def _bus(link: Path) -> can.BusABC:
    return open_bus(_settings(link))


def _settings(link: Path) -> CanSettings:
    return CanSettings(interface="slcan", channel=str(link))


@contextmanager
def _devices() -> Iterator[CanSettings]:
    """Hub, drive and transducer; the settings of the host's adapter."""
    context = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory() as folder:
        links = [Path(folder) / name for name in ("host", "drive", "cell")]
        processes: list[SpawnProcess] = []

        def begin(target: Callable[..., None], argument: object) -> None:
            process = context.Process(target=target, args=(argument,), daemon=True)
            process.start()
            processes.append(process)

        begin(_hub, links)
        while not all(link.exists() for link in links):
            time.sleep(0.01)
        begin(_drive, links[1])
        begin(_cell, links[2])
        time.sleep(3.0)  # until they have imported what they need
        try:
            yield _settings(links[0])
        finally:
            for process in reversed(processes):
                process.kill()
                process.join()


# --- what is measured ---


class _RoundTrips:
    """From SYNC to the drive's TPDO, at the host."""

    def __init__(self) -> None:
        self.taken_ns: list[int] = []
        self.sent = 0
        self._sent_ns = 0

    def sync(self) -> None:
        """To be called before SYNC is sent."""
        self._sent_ns = time.monotonic_ns()
        self.sent += 1

    def answer(self) -> None:
        """To be called when the TPDO is there."""
        if self._sent_ns:
            self.taken_ns.append(time.monotonic_ns() - self._sent_ns)
            self._sent_ns = 0

    def print(self, what: str, cpu_s: float, wall_s: float) -> None:
        """One line."""
        taken = sorted(self.taken_ns)
        if not taken:
            print(f"{what}: no answer")
            return
        p50, p99 = (1e-6 * taken[int(share * (len(taken) - 1))] for share in (0.5, 0.99))
        print(
            f"{what}: {self.sent / wall_s:.0f} SYNC/s, {self.sent - len(taken)} of {self.sent} without an "
            f"answer before the next, round trip {p50:.2f} ms (99 %: {p99:.2f}), "
            f"{100 * cpu_s / wall_s:.0f} % of one core"
        )


def _driver(bus: CanSettings, rate_hz: int) -> None:
    trips = _RoundTrips()
    shared = acquire(bus)
    _instrument(shared, trips)
    stage = Cia402Stage(_stage_settings(bus, rate_hz))
    cell = Cia404LoadCell(_cell_settings(bus, rate_hz))
    try:
        stage.open()
        cell.open()
        trips.taken_ns.clear()
        trips.sent = 0
        start_s, start_cpu_s = time.monotonic(), time.process_time()
        forces = _control(stage, cell, start_s)
        wall_s = time.monotonic() - start_s
        trips.print(f"drivers at {rate_hz} Hz", time.process_time() - start_cpu_s, wall_s)
        print(f"  {forces} forces of {trips.sent} SYNC, late cycles {stage.link.counters['late_cycles']}")
    except DeviceError as error:
        print(f"drivers at {rate_hz} Hz: ended by a fault: {error}")
    finally:
        stage.close()
        cell.close()
        release(shared)


def _instrument(shared: SharedNetwork, trips: _RoundTrips) -> None:
    send = shared.send

    def stamped(can_id: int, data: bytes) -> None:
        if can_id == SYNC:
            trips.sync()
        send(can_id, data)

    shared.send = stamped  # type: ignore[method-assign]
    shared.subscribe(state_pdo(_DRIVE_NODE).can_id, lambda _id, _data, _stamp: trips.answer())


def _control(stage: Cia402Stage, cell: Cia404LoadCell, start_s: float) -> int:
    """The slave's control loop at 1 kHz, as far as these devices see it."""
    clock, forces = MonotonicClock(), 0
    home_m = stage.read(clock.now_ns()).position_m
    pacer = Pacer(clock, 1_000_000)
    while time.monotonic() - start_s < _LASTS_S:
        now_ns = clock.now_ns()
        stage.read(now_ns)
        stage.command(home_m, 0.0, now_ns)
        forces += len(cell.read(now_ns, None))
        time.sleep(pacer.wait_s())
    return forces


def _stage_settings(bus: CanSettings, rate_hz: int) -> Cia402Settings:
    stage = preset("catheter").stage
    return Cia402Settings(
        driver="cia402",
        can=bus,
        node_id=_DRIVE_NODE,
        counts_per_m=_COUNTS_PER_M,
        travel_m=(stage.travel_lower_m, stage.travel_upper_m),
        sync_hz=rate_hz,
        heartbeat_s=0.1,
    )


def _cell_settings(bus: CanSettings, rate_hz: int) -> Cia404Settings:
    return Cia404Settings(driver="cia404", can=bus, node_id=_CELL_NODE, full_scale_n=10.0, rate_hz=rate_hz)


def _raw(settings: CanSettings, rate_hz: int) -> None:
    """The same frames through python-can alone, to the devices that the drivers have configured."""
    bus, trips = open_bus(settings), _RoundTrips()
    stopping, answer_id = threading.Event(), state_pdo(_DRIVE_NODE).can_id

    def receive() -> None:
        while not stopping.is_set():
            message = bus.recv(0.05)
            if message is not None and message.arbitration_id == answer_id:
                trips.answer()

    receiver = threading.Thread(target=receive)
    receiver.start()
    bus.send(_frame(NMT, bytes([START, 0])))
    time.sleep(0.1)
    start_s, start_cpu_s, clock = time.monotonic(), time.process_time(), MonotonicClock()
    pacer, command = Pacer(clock, round(1e9 / rate_hz)), command_pdo(_DRIVE_NODE)
    while time.monotonic() - start_s < _LASTS_S:
        bus.send(_frame(command.can_id, command.pack(cia402.QUICK_STOP, 0)))
        trips.sync()
        bus.send(_frame(SYNC, b""))
        if trips.sent % 10 == 0:
            bus.send(_frame(HEARTBEAT + HOST_NODE, bytes([OPERATIONAL])))
        time.sleep(pacer.wait_s())
    wall_s = time.monotonic() - start_s
    trips.print(f"raw frames at {rate_hz} Hz", time.process_time() - start_cpu_s, wall_s)
    stopping.set()
    receiver.join()
    bus.shutdown()


def _frame(can_id: int, data: bytes) -> can.Message:
    return can.Message(arbitration_id=can_id, data=data, is_extended_id=False)


if __name__ == "__main__":
    main()
