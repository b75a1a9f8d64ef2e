"""The Zaber driver beside a raw pty, its parser under damage: `python -m benchmarks.hardware_zaber`.

The device is a process of its own. The wire of the emulated stage is paced at 115200 baud, as a real one is,
or hardly at all, where what is left is the driver, the terminal and the 1 ms steps of the emulator.
"""

import multiprocessing
import os
import random
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from forefeel.devices.emulation.pty import Pty, PtyServer
from forefeel.devices.shared.settings import SerialSettings
from forefeel.devices.shared.stream import SerialStream
from forefeel.devices.zaber.driver import ZaberExchange, ZaberStage
from forefeel.devices.zaber.emulator import ZaberDevice, ZaberModel
from forefeel.devices.zaber.protocol import Parser, Reply, lrc
from forefeel.devices.zaber.settings import ZaberSettings

_SECONDS = 10.0  # s of each measurement
_FRAMES = 100_000  # frames of the test of damage
_DAMAGED = 0.01  # share of these that is damaged
_MODEL = ZaberModel(limits_m=(0.0, 0.2))
_QUESTION = b"/1 1 05 move abs 123456:2F\n/1 1 06 get pos:26\n"  # an exchange of the driver
_UNPACED_BAUD = 12_000_000  # bit/s: full speed of USB, so that the wire takes hardly any time
_WIRES = (115_200, _UNPACED_BAUD)


def main() -> None:
    """Prints one line a figure."""
    with tempfile.TemporaryDirectory() as folder:
        link = Path(folder) / "port"
        with _process(_echo, link):
            _report("raw pty echo, a process of its own", *_echoed(link))
        for baud in _WIRES:
            with _process(_emulate, link, baud):
                _report(f"driver, emulated stage at {baud} baud", *_driven(link, baud))
    _damaged()


def _report(name: str, round_trips_s: list[float], cpu_share: float) -> None:
    ordered = sorted(round_trips_s)
    median_s, late_s = (ordered[int(share * (len(ordered) - 1))] for share in (0.5, 0.99))
    rate_hz = len(ordered) / sum(ordered)
    print(
        f"{name}: round trip p50 {median_s * 1e3:.2f} ms, p99 {late_s * 1e3:.2f} ms, "
        f"{rate_hz:.0f} exchanges/s, {cpu_share:.1%} of one core"
    )


def _echoed(link: Path) -> tuple[list[float], float]:
    stream = SerialStream(SerialSettings(port=str(link)))
    round_trips_s, start_s, cpu_s = list[float](), time.monotonic(), time.process_time()
    while (sent_s := time.monotonic()) < start_s + _SECONDS:
        stream.write(_QUESTION)
        missing = len(_QUESTION)
        while missing > 0:
            missing -= len(stream.read())
        round_trips_s.append(time.monotonic() - sent_s)
    stream.close()
    return round_trips_s, (time.process_time() - cpu_s) / _SECONDS


def _driven(link: Path, baud: int) -> tuple[list[float], float]:
    """Round trips of the exchanges of the driver's thread while it follows a setpoint."""
    stage = ZaberStage(
        ZaberSettings(
            driver="zaber_ascii", port=str(link), baud=baud, microstep_m=1e-7, travel_m=(0.0, 0.2),
            max_velocity_m_s=0.05,
        )
    )  # fmt: skip
    round_trips_s = list[float]()
    step = ZaberExchange.step

    def timed(exchange: ZaberExchange) -> None:
        began_s = time.monotonic()
        step(exchange)
        round_trips_s.append(time.monotonic() - began_s)

    stage.open()
    try:
        ZaberExchange.step = timed  # type: ignore[method-assign, assignment]
        cpu_s, start_s = time.process_time(), time.monotonic()
        while (now_s := time.monotonic()) < start_s + _SECONDS:
            stage.command(0.01 * (now_s - start_s), 0.01, time.monotonic_ns())
            time.sleep(0.05)  # the control loop is not what is measured
        cpu_share = (time.process_time() - cpu_s) / _SECONDS
    finally:
        ZaberExchange.step = step  # type: ignore[method-assign]
        stage.close()
    print(f"  counters {dict(stage.link.counters)}")
    return round_trips_s, cpu_share


@contextmanager
def _process(serve: Callable[..., None], link: Path, *arguments: object) -> Iterator[None]:
    child = multiprocessing.get_context("spawn").Process(target=serve, args=(link, *arguments), daemon=True)
    child.start()
    while not link.exists():
        time.sleep(0.01)
    try:
        yield
    finally:
        assert child.pid is not None
        os.kill(child.pid, signal.SIGTERM)
        child.join()
        link.unlink()


def _echo(link: Path) -> None:
    pty = Pty(link)
    while True:
        pty.write(pty.read(1.0))


def _emulate(link: Path, baud: int) -> None:
    server = PtyServer(ZaberDevice(_MODEL), Pty(link), baud)
    while True:
        server.step()


def _damaged() -> None:
    """One byte of a share of the frames is another: what is lost, what is taken for something else."""
    chosen = random.Random(1)
    frames = [_frame(number) for number in range(_FRAMES)]
    damaged = {number for number in range(_FRAMES) if chosen.random() < _DAMAGED}
    stream = b"".join(_hurt(frame, chosen) if n in damaged else frame for n, frame in enumerate(frames))
    wanted = {Parser().feed(frame)[0] for frame in frames}
    start_s, parser = time.perf_counter(), Parser()
    found: list[Reply] = []
    for at in range(0, len(stream), 64):
        found += parser.feed(stream[at : at + 64])
    took_s = time.perf_counter() - start_s
    lost = set(range(_FRAMES)) - {int(message.data) for message in found if message in wanted}
    print(
        f"parser: {_FRAMES} frames, {len(damaged)} damaged, {len(lost)} lost, of these intact "
        f"{len(lost - damaged)}; {len(found) - (_FRAMES - len(lost))} wrong messages; "
        f"{took_s / _FRAMES * 1e6:.1f} µs a frame; dropped {dict(parser.dropped)}"
    )


def _frame(number: int) -> bytes:
    body = b"01 1 %02d OK BUSY -- %d" % (number % 100, number)
    return b"@%s:%02X\r\n" % (body, lrc(body))


def _hurt(frame: bytes, chosen: random.Random) -> bytes:
    at = chosen.randrange(len(frame))
    return frame[:at] + bytes([frame[at] ^ chosen.randrange(1, 256)]) + frame[at + 1 :]


if __name__ == "__main__":
    main()
