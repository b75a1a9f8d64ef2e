"""The coil handle's link: round trip, CPU, frames lost: `python -m benchmarks.hardware_handle`."""

import multiprocessing
import os
import select
import tempfile
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random

from forefeel.common.clock import MonotonicClock
from forefeel.common.hardware.link import DeviceLink, LinkState
from forefeel.devices.coil.driver import CoilHandle, CoilTalk
from forefeel.devices.coil.emulator import CoilDevice
from forefeel.devices.coil.protocol import PROTOCOL, CoilCommand, Identify, encode
from forefeel.devices.coil.settings import CoilSettings
from forefeel.devices.emulation.pty import Pty, PtyServer
from tests.emulators.damage import DamagedWire, Faults

_TRIALS = 1000  # round trips
_CPU_S = 10.0  # s over which processor time is counted
_FRAMES = 100_000  # frames of the test of damage
_BAUD = 2_000_000  # bit/s, the default of `CoilSettings.baud`


def main() -> None:
    """Prints one line a figure."""
    with tempfile.TemporaryDirectory() as folder:
        port = Path(folder) / "handle"
        with _device(port):
            handle = CoilHandle(_settings(port), MonotonicClock())
            handle.open()
            try:
                _round_trip(handle)
                driver = _cpu_share(lambda: handle.render(0.0, 0))
            finally:
                handle.close()
            frames, faults = handle.counters["frames"], handle.counters["faults"]
            print(f"driver: {frames} frames, {handle.counters['frames_lost']} lost, {faults} faults")
        with _device(port):
            raw = _raw_echo(port)
    print(f"CPU at 1 kHz both ways: driver {driver:.1%} of a core, a thread that echoes raw bytes {raw:.1%}")
    _lost_frames()


def _settings(port: Path) -> CoilSettings:
    return CoilSettings(
        driver="coil_serial",
        port=str(port),
        counts_per_m=1e6,
        newton_per_ampere=2.0,
        max_current_a=3.0,
        watchdog_s=0.1,
    )


@contextmanager
def _device(port: Path) -> Iterator[None]:
    """The emulated device in a process of its own."""
    context = multiprocessing.get_context("spawn")
    process = context.Process(target=_serve, args=(port,), daemon=True)
    process.start()
    try:
        while not port.is_symlink():
            time.sleep(0.01)
        yield
    finally:
        process.terminate()
        process.join()
        port.unlink(missing_ok=True)


def _serve(port: Path) -> None:
    with Pty(port) as pty:
        server = PtyServer(CoilDevice(), pty, _BAUD)
        while True:
            server.step()


def _round_trip(handle: CoilHandle) -> None:
    """From `render` to the arrival of the state that reports that current."""
    rng, found_ms = Random(1), list[float]()
    for trial in range(_TRIALS):
        time.sleep(rng.uniform(0.001, 0.003))
        current_ma = 100 + trial % 2
        start_ns = time.monotonic_ns()
        handle.render(current_ma * 2e-3, start_ns)
        while (newest := handle._talk.newest) is None or newest.state.current_ma != current_ma:
            time.sleep(50e-6)
            handle.render(current_ma * 2e-3, time.monotonic_ns())
        found_ms.append((newest.arrived_ns - start_ns) * 1e-6)
    found_ms.sort()
    p50, p99 = found_ms[_TRIALS // 2], found_ms[_TRIALS * 99 // 100]
    print(f"round trip render, coil, state: p50 {p50:.2f} ms, p99 {p99:.2f} ms, max {found_ms[-1]:.2f} ms")


def _cpu_share(begin: Callable[[], object]) -> float:
    """Share of a core that this process takes, while its main thread sleeps."""
    begin()
    cpu_s, wall_s = time.process_time(), time.monotonic()
    time.sleep(_CPU_S)
    return (time.process_time() - cpu_s) / (time.monotonic() - wall_s)


def _raw_echo(port: Path) -> float:
    """A thread that answers each state with the same bytes, and looks at none."""
    end, done = os.open(port, os.O_RDWR | os.O_NOCTTY), threading.Event()
    tty.setraw(end)
    command = encode(CoilCommand(1, 0, None, None, False))

    def echo() -> None:
        while not done.is_set():
            if select.select([end], [], [], 0.1)[0] and os.read(end, 4096):
                os.write(end, command)

    thread = threading.Thread(target=echo)
    os.write(end, encode(Identify(PROTOCOL, 100, 3000)))
    try:
        return _cpu_share(thread.start)
    finally:
        done.set()
        thread.join()
        os.close(end)


def _lost_frames() -> None:
    """In virtual time: one wrong byte in one of a hundred frames, both ways."""
    faults = Faults(corrupt=0.01)
    device, link = CoilDevice(), DeviceLink("handle")
    talk = CoilTalk(_settings(Path("memory")), link)
    clean, broken = DamagedWire(_BAUD, Faults()), [DamagedWire(_BAUD, faults, way) for way in ("out", "in")]
    link.advance(LinkState.OPEN)
    question, tick = talk.begin(0), 0
    while link.counters["frames"] + link.counters["frames_lost"] < _FRAMES:
        tick += 1
        t_s = tick * 1e-3
        to_host, to_device = broken if talk.settled else (clean, clean)
        to_device.send(question, t_s)
        device.receive(to_device.arrived(t_s + 0.5e-3), t_s)
        to_host.send(device.advance(t_s), t_s)
        question = talk.hear(to_host.arrived(t_s + 0.9e-3), round((t_s + 0.9e-3) * 1e9))
    for way, lost, wire in (
        ("device -> host", link.counters["frames_lost"], broken[0]),
        ("host -> device", device.counters["commands_lost"], broken[1]),
    ):
        sent, corrupted = wire.counts["chunks"], wire.counts["corrupted"]
        print(f"{way}: {sent} frames, {corrupted} corrupted, {lost} lost")
    print(f"link {link.state.name}, {link.counters['faults']} faults; dropped by the host: {_dropped(link)}")


def _dropped(link: DeviceLink) -> str:
    return ", ".join(f"{name} {number}" for name, number in link.counters.items() if name.startswith("bad_"))


if __name__ == "__main__":
    main()
