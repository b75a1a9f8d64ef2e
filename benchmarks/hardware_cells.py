"""The serial load cells: `python -m benchmarks.hardware_cells`.

What the driver of a Bota cell costs beside readers of the same pseudo terminal that only read, and how old
its readings are; the frames that are lost where one in a hundred is damaged.
"""

import multiprocessing
import os
import platform
import select
import sys
import tempfile
import threading
import time
import tty
from collections import Counter
from collections.abc import Callable
from math import sin
from pathlib import Path
from typing import NamedTuple

from forefeel.common.errors import ForefeelError
from forefeel.devices.bota.driver import BotaCell, BotaSerialLoadCell
from forefeel.devices.bota.emulator import EmulatedBota
from forefeel.devices.bota.protocol import FRAME_BYTES
from forefeel.devices.bota.settings import BotaSettings
from forefeel.devices.emulation.pty import Pty, PtyServer
from forefeel.devices.emulation.sensing import EmulatedSensor
from forefeel.devices.shared.stream import SerialStream
from tests.emulators.damage import DamagedWire, Faults

_SECONDS = 10.0  # s of each measurement
_FRAMES, _DAMAGED = 100_000, 0.01  # frames, and share of them with one damaged byte
# Hz and bit/s: the defaults of `BotaSettings`, and its highest rate
_RATES = (800.0, 460_800), (2000.0, 921_600)


class Cost(NamedTuple):
    """CPU time per wall time of the reading process, frames per second, ages of the readings in ms."""

    cpu: float
    per_s: float
    ages_ms: list[float]


def main() -> None:
    """Prints two tables."""
    print(f"{platform.machine()}, {os.cpu_count()} cores, Python {sys.version.split()[0]}")
    for rate_hz, baud in _RATES:
        _costs(rate_hz, baud)
    _damage()


def _settings(port: Path, rate_hz: float, baud: int) -> BotaSettings:
    given = {"driver": "bota_serial", "port": str(port), "full_scale_n": 10, "rate_hz": rate_hz, "baud": baud}
    return BotaSettings.model_validate(given)


# --- CPU ---


def _costs(rate_hz: float, baud: int) -> None:
    print(f"\nBota frames at {rate_hz:g} Hz, {baud} baud, {_SECONDS:g} s each: CPU of one core")
    with tempfile.TemporaryDirectory() as folder:
        port = Path(folder) / "cell"
        readers: dict[str, Callable[[BotaSettings], Cost]] = {
            "os.read of the pty": _raw,
            "pyserial, the bytes alone": _bytes,
            "forefeel, read at 1 kHz": _driver,
        }
        for name, reader in readers.items():
            emulator = multiprocessing.get_context("spawn").Process(
                target=_emulate, args=(port, rate_hz, baud), daemon=True
            )
            emulator.start()
            try:
                _print_cost(name, _when_there(port, lambda r=reader: r(_settings(port, rate_hz, baud))))  # type: ignore[misc]
            finally:
                emulator.terminate()
                emulator.join()
                port.unlink(missing_ok=True)


def _print_cost(name: str, cost: Cost) -> None:
    text = f"  {100 * cost.cpu:5.1f} %  {cost.per_s:7.1f} frames/s  {name}"
    if cost.ages_ms:
        ages = sorted(cost.ages_ms)
        p50, p99 = ages[len(ages) // 2], ages[len(ages) * 99 // 100]
        text += f"; readings are {p50:.2f} ms old (p50), {p99:.2f} ms (p99)"
    print(text)


def _emulate(port: Path, rate_hz: float, baud: int) -> None:
    with Pty(port) as pty:
        server = PtyServer(EmulatedBota(EmulatedSensor(sin, rate_hz)), pty, baud)
        while True:
            server.step()


def _when_there(port: Path, measure: Callable[[], Cost]) -> Cost:
    end_s = time.monotonic() + 20.0
    while not port.exists() and time.monotonic() < end_s:
        time.sleep(0.05)
    return measure()


def _measured(step: Callable[[], int], cpu_s: Callable[[], float] = time.process_time) -> Cost:
    """Runs `step`, which says how many bytes or frames there were."""
    start_s, cpu_start_s, count = time.monotonic(), cpu_s(), 0
    while (wall_s := time.monotonic() - start_s) < _SECONDS:
        count += step()
    return Cost((cpu_s() - cpu_start_s) / wall_s, count / wall_s, [])


def _raw(settings: BotaSettings) -> Cost:
    descriptor = os.open(settings.port, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(descriptor)

    def step() -> int:
        select.select([descriptor], [], [], 0.02)
        return len(os.read(descriptor, 4096))

    cost = _measured(step)
    os.close(descriptor)
    return cost._replace(per_s=cost.per_s / FRAME_BYTES)


def _bytes(settings: BotaSettings) -> Cost:
    stream = SerialStream(settings)
    cost = _measured(lambda: len(stream.read()))
    stream.close()
    return cost._replace(per_s=cost.per_s / FRAME_BYTES)


def _driver(settings: BotaSettings) -> Cost:
    """The CPU time of the driver's own thread; what the 1 kHz loop takes from it is little."""
    driver = BotaSerialLoadCell(settings)
    driver.open()
    (thread,) = (each for each in threading.enumerate() if each.name == driver.link.name)
    clock = time.pthread_getcpuclockid(thread.ident or 0)
    ages: list[float] = []

    def step() -> int:
        time.sleep(0.001)
        now_ns = time.monotonic_ns()
        found = driver.read(now_ns, None)
        ages.extend((now_ns - reading.stamp_ns) * 1e-6 for reading in found if reading.stamp_ns)
        return len(found)

    cost = _measured(step, lambda: time.clock_gettime(clock))
    counters = dict(driver.link.counters)
    driver.close()
    told = ("missing", "junk_bytes", "unread", "faults")
    print("  counters of the driver: " + ", ".join(f"{name} {counters.get(name, 0)}" for name in told))
    return cost._replace(ages_ms=ages)


# --- damage ---


def _damage() -> None:
    """A frame each millisecond and a quarter over a wire that damages; the driver without its thread."""
    device = EmulatedBota(EmulatedSensor(sin, 800.0))
    wire = DamagedWire(460_800, Faults(corrupt=_DAMAGED), "out 0")
    counters = Counter[str]()
    cell = BotaCell(_settings(Path("cell"), 800.0, 460_800), counters)
    found, spent_s = 0, 0.0
    for n in range(_FRAMES + 1):  # one more call delivers what is under way
        t_s = (n + 1) / 800.0
        arrived = wire.arrived(t_s)
        start_s = time.perf_counter()
        found += len(cell.take(arrived, round(t_s * 1e9)))
        spent_s += time.perf_counter() - start_s
        if n < _FRAMES:
            wire.send(device.advance(t_s), t_s)
    damaged, lost = wire.counts["corrupted"], _FRAMES - found
    print(f"\n{_FRAMES} frames, {_DAMAGED:.0%} of them damaged in one byte")
    print(f"  damaged {damaged}, lost {lost}, junk / 37 bytes {counters['junk_bytes'] / FRAME_BYTES:g}")
    print(f"  missing by the cell's clock {counters['missing']}, bad checksums {counters['bad_checksum']}")
    print(f"  {spent_s / _FRAMES * 1e6:.1f} us per frame from bytes to stamped measurement")
    if damaged != lost:
        raise ForefeelError(f"damaged {damaged}, lost {lost}: expected as many")


if __name__ == "__main__":
    main()
