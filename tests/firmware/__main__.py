"""`python -m tests.firmware IMAGES MODULES`: the firmware in emulated chips, held to our drivers.

IMAGES: what `make -C firmware` builds, with a folder `index` of those with INDEX=1; MODULES: the folder
node_modules with avr8js and rp2040js. What can not be had (QEMU, node, a module) is listed as not run.
Exit 1: a check failed.
"""

import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random

from forefeel.common.errors import DeviceError, DeviceSetupError
from forefeel.common.hardware.link import LinkState
from forefeel.common.messages import SafetyState
from forefeel.devices.ascii_line.protocol import encode_line
from forefeel.devices.coil.driver import CoilHandle
from forefeel.devices.coil.protocol import Flag
from forefeel.master.handle import HandleReading, Indication
from forefeel.testing import SerialLine, SteppedTime, stepped
from tests.devices.coil_rig import coil_settings
from tests.firmware.chips import Node, Qemu

STATES, MOST_MA, WATCHDOG_MS = 10_000, 1000, 50
COUNTS_PER_S = 40_000
LATE_US = 500  # of the 1500 that the firmware says; the rest is the motor's


class Bench:
    """A handle's firmware on a line to our driver, while a haptic loop reads it and renders `force_n`."""

    def __init__(self, time: SteppedTime, chip: Qemu | Node) -> None:
        self.time, self.chip, chip.time = time, chip, time
        self.line = SerialLine(time, chip, 12_000_000)  # the chips take the time of their own UART
        self.handle = self.new_handle()
        self.force_n, self.reading, self.echoes = 0.0, HandleReading(0.0, 0.0, False), 0
        time.tick = self._tick

    def new_handle(self) -> CoilHandle:
        return CoilHandle(coil_settings(watchdog_s=WATCHDOG_MS * 1e-3, newton_per_ampere=1.0), self.time)

    def _tick(self, now_ns: int) -> None:
        self.handle.show(Indication(SafetyState.ARMED, 0.01))
        try:
            self.reading = self.handle.read(now_ns)
            self.handle.render(self.force_n, now_ns)
        except DeviceError:
            pass

    @property
    def current_ma(self) -> int:
        newest = self.handle._talk.newest
        return 0 if newest is None else newest.state.current_ma

    def expect_current(self, force_n: float, current_ma: int) -> None:
        self.force_n = force_n
        self.time.run_until(lambda: self.current_ma == current_ma or self.handle.link.inhibited)
        assert not self.handle.link.inhibited, self.handle.link.inhibited
        if isinstance(self.chip, Node):
            self.time.run(0.005)
            assert (self.chip.duty > 0) - (self.chip.duty < 0) == (current_ma > 0) - (current_ma < 0)

    def expect_no_current(self) -> None:
        """After a fault: not before the link has been re-armed."""
        assert self.handle.link.inhibited
        self.time.run_until(lambda: self.handle.link.state is LinkState.CONFIGURED)
        self.time.run(0.1)
        assert self.current_ma == 0
        assert not isinstance(self.chip, Node) or self.chip.duty == 0
        self.handle.rearm()
        self.expect_current(0.3, 300)


def check_states(bench: Bench) -> str:
    counters, wave = bench.handle.counters, Random(1)
    while counters["frames"] < STATES:
        current_ma = wave.randrange(-1500, 1500)
        bench.expect_current(current_ma * 1e-3, max(-MOST_MA, min(MOST_MA, current_ma)))
        bench.echoes += 1
        bench.time.run(0.2)
    bad = {name: counters[name] for name in ("frames_lost", "bad_framing", "bad_checksum", "unknown_frame")}
    assert not any(bad.values()) and bench.handle.link.state is LinkState.READY, bad
    return f"{counters['frames']} states, none bad or lost; {bench.echoes} currents of both signs echoed"


def check_pins(bench: Bench) -> str:
    chip = bench.chip
    assert isinstance(chip, Node)
    for pressed in (True, False, True):
        chip.order(pins={"deadman": not pressed})  # a switch to ground
        bench.time.run(0.02)
        assert bench.reading.deadman is pressed
    for delay_us in range(
        0, 1000, 20
    ):  # at every phase of the chip's period, half of them at another current
        chip.order(delay_us=delay_us)
        bench.force_n = 0.1 + 0.001 * delay_us
        bench.time.run(0.001)
    before = round(bench.reading.position_m * 1e6)
    for _ in range(1000):
        chip.order(edges=COUNTS_PER_S // 1000)
    bench.time.run(0.9)
    assert abs(bench.reading.velocity_m_s * 1e6 - COUNTS_PER_S) < 500, bench.reading
    bench.time.run(0.2)
    assert round(bench.reading.position_m * 1e6) - before == COUNTS_PER_S, bench.reading
    assert bench.handle.counters["frames_lost"] == 0
    assert 0.0 < chip.late_us <= LATE_US, chip.late_us
    return (
        f"deadman; {COUNTS_PER_S} counts in a second, none lost; a current at most {chip.late_us:.0f} us late"
    )


def check_host_that_stops(bench: Bench) -> str:
    bench.expect_current(0.7, 700)
    bench.time.host_hangs(0.5 * WATCHDOG_MS * 1e-3)
    newest = bench.chip.newest
    assert newest is not None and newest.current_ma == 700 and not newest.flags
    bench.time.host_hangs(2.0 * WATCHDOG_MS * 1e-3)
    newest = bench.chip.newest
    assert newest is not None and newest.current_ma == 0 and newest.flags == Flag.WATCHDOG, (
        newest,
        bench.time.t_s,
    )
    assert not isinstance(bench.chip, Node) or bench.chip.duty == 0
    bench.time.run(0.02)
    bench.expect_no_current()
    return f"its watchdog of {WATCHDOG_MS} ms takes the current away; re-armed"


def check_garbage(bench: Bench) -> str:
    random, counters = Random(2), bench.handle.counters
    for _ in range(20):
        bench.line.to_device.send(random.randbytes(random.randrange(1, 40)), bench.time.t_s)
        bench.line.to_host.send(random.randbytes(random.randrange(1, 40)), bench.time.t_s)
        bench.time.run(0.02)
    counted = {name: counters[name] for name in ("bad_framing", "bad_checksum") if counters[name]}
    assert counted and bench.handle.link.state is LinkState.READY, counted
    bench.expect_current(-0.4, -400)
    return f"garbage both ways survived, counted: {counted}"


def check_reset(bench: Bench) -> str:
    bench.expect_current(0.7, 700)
    bench.chip.reset()
    bench.time.run_until(lambda: bench.handle.link.inhibited)
    reason = bench.handle.link.inhibited
    bench.expect_no_current()
    return f"a reset is a fault ({reason}); identified again, re-armed"


def check_hang(bench: Bench) -> str:
    chip = bench.chip
    assert isinstance(chip, Node)
    bench.expect_current(0.7, 700)
    chip.order(hang=True)
    bench.time.run(0.01)
    assert chip.duty != 0  # only the chip's own watchdog can help now
    bench.time.run(0.04)
    assert chip.duty == 0
    bench.time.run_until(lambda: bench.handle.link.inhibited)
    bench.expect_no_current()
    return "firmware that hangs: the chip's watchdog takes the current away within 50 ms; re-armed"


@contextmanager
def closed(chip: Qemu | Node) -> Iterator[Bench]:
    with stepped() as time:
        bench = Bench(time, chip)
        try:
            yield bench
        finally:
            bench.handle.close()
            chip.close()


def check_handle(name: str, chip: Qemu | Node) -> None:
    checks: list[Callable[[Bench], str]] = [check_states, check_host_that_stops, check_garbage, check_reset]
    if isinstance(chip, Node):
        checks = [check_states, check_pins, *checks[1:], check_hang]
    with closed(chip) as bench:
        bench.handle.open()
        print(f"{name}: READY: {bench.handle.link.identity}", flush=True)
        for check in checks:
            print(f"{name}: {check(bench)}", flush=True)


def check_index(name: str, chip: Node) -> None:
    with closed(chip) as bench:
        try:
            bench.handle.open()
        except DeviceSetupError as error:
            assert "the encoder has no zero yet" in str(error), error
        else:
            raise AssertionError("ready without a zero")
        chip.order(edges=40)
        chip.order(pins={"index": True})
        bench.handle = bench.new_handle()
        bench.handle.open()
        bench.time.run(0.02)
        assert bench.reading.position_m == 0.0
        bench.expect_current(0.3, 300)
    print(f"{name}: with INDEX=1 refused before the encoder's index, and zero there", flush=True)


def check_load_cell(name: str, chip: Node) -> None:
    numbers = [0, 1, -1, 123_456, -7_654_321, (1 << 23) - 1, -(1 << 23)]
    for at, number in enumerate(numbers):
        chip.order(count=number)
        lines = chip.advance(0.2 * (at + 1)).splitlines(keepends=True)
        assert len(lines) >= 14, lines  # 80 Hz, less what the conversion and the line take
        assert set(lines[2:]) == {encode_line(number, "counts")}, lines
    chip.close()
    print(f"{name}: {len(numbers)} readings from end to end of the 24 bits as lines of ascii_line")


def main(images: Path, modules: Path) -> None:
    if shutil.which("qemu-system-avr"):
        check_handle("handle, ATmega328P, QEMU", Qemu(images / "handle_avr.elf"))
    else:
        print("handle, ATmega328P, QEMU: built, not run")
    for name, kind, image, module in (
        ("handle, ATmega328P, avr8js", "handle_avr", "handle_avr.hex", "avr8js"),
        ("handle, RP2040, rp2040js", "handle_rp2040", "handle_rp2040.bin", "rp2040js"),
        ("load cell, ATmega328P, avr8js", "hx711_avr", "hx711_avr.hex", "avr8js"),
    ):
        if not (shutil.which("node") and (modules / module).is_dir()):
            print(f"{name}: built, not run")
        elif kind == "hx711_avr":
            check_load_cell(name, Node(kind, images / image, modules))
        else:
            check_index(name, Node(kind, images / "index" / image, modules))
            check_handle(name, Node(kind, images / image, modules))


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
