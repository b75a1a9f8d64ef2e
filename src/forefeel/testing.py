"""Contracts of drivers: pytest classes to subclass, and the stepped time that they run in.

    class TestIioLoadCell(LoadCellContract):
        driver = "iio"

The driver talks to its emulated device (its `Emulation`) without a thread, a port or a bus: its
`Conversation` is stepped, `SerialStream` and CAN buses are in memory, and time passes while it waits. So it
has to use these three, and the clock that it is made with.
"""

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partialmethod
from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import Any, ClassVar

import can
import canopen
import pytest

from forefeel.common.clock import VirtualClock
from forefeel.common.errors import DeviceError, DeviceSetupError, ForefeelError
from forefeel.common.hardware.driver import DriverSettings, InstalledDriver, Slot, imported, installed_driver
from forefeel.common.hardware.link import LinkState
from forefeel.devices.canopen.network import SharedNetwork
from forefeel.devices.emulation.bench import Emulation, SerialBench, Surroundings
from forefeel.devices.emulation.wire import EmulatedDevice, Wire
from forefeel.devices.shared.conversation import Conversation
from forefeel.devices.shared.settings import CanSettings, SerialSettings
from forefeel.devices.shared.stream import SerialStream
from forefeel.slave.plant.settings import preset

_START_NS = 1_000_000_000


class SteppedTime(VirtualClock):
    """The clock of drivers and emulated devices: whoever waits for it has all of them live until then.

    Attributes:
        devices: called with the time since the start in s, at each step.
        tick: called with the stamp at each step, as a control loop of 1 kHz would be.
    """

    def __init__(self, step_ns: int = 1_000_000) -> None:
        super().__init__(_START_NS)
        self.devices: list[Callable[[float], object]] = []
        self.tick: Callable[[int], object] = lambda now_ns: None
        self.lines: dict[str, SerialLine] = {}
        self.buses: list[SteppedCanBus] = []
        self.networks: list[SharedNetwork] = []
        self._step_ns, self._due_ns = step_ns, dict[Conversation, int]()
        self._in_step = self._delivering = False

    @property
    def t_s(self) -> float:
        """Time since the start in s."""
        return (self.now_ns() - _START_NS) * 1e-9

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Advances to that stamp, with devices and conversations; in a conversation with devices alone."""
        while not self._in_step and self.now_ns() < deadline_ns:
            self._advance(deadline_ns)
        self._live_until(deadline_ns)

    def run(self, seconds: float) -> None:
        self.sleep_until_ns(self.now_ns() + round(seconds * 1e9))

    def run_until(self, condition: Callable[[], object], within_s: float = 20.0) -> None:
        """Lets everything live until the condition is true; AssertionError when it never is."""
        end_ns = self.now_ns() + round(within_s * 1e9)
        while not condition():
            assert self.now_ns() < end_ns, f"not within {within_s:g} s"
            self._advance(self.now_ns() + self._step_ns)

    def host_hangs(self, seconds: float) -> None:
        """Advances the time with devices and control loop, but without the conversations of drivers."""
        self._live_until(self.now_ns() + round(seconds * 1e9))

    def _live_until(self, deadline_ns: int) -> None:
        """Steps clock, devices, CAN frames and control loop until then, and no conversation of a driver."""
        while (now_ns := self.now_ns()) < deadline_ns:
            self.set_ns(min(now_ns + self._step_ns, deadline_ns))
            for live in self.devices:
                live(self.t_s)
            self.deliver()
            self.tick(self.now_ns())

    def _advance(self, until_ns: int) -> None:
        """Lets time pass until the next step of a driver's conversation is due, by `until_ns` at most, and
        makes that one step. Notes when the conversation is due again, or drops it at its end.
        """
        due_ns, talks = min(((due, talks) for talks, due in self._due_ns.items()), key=lambda pair: pair[0],
                            default=(until_ns + 1, None))  # fmt: skip
        self._live_until(min(due_ns, until_ns))
        if talks is None or due_ns > until_ns:
            return
        self._in_step = True
        try:
            wait_s = talks.step()
        finally:
            self._in_step = False
        if wait_s is None:
            self._due_ns.pop(talks, None)
        else:
            self._due_ns[talks] = self.now_ns() + round(wait_s * 1e9)

    # --- in the place of threads ---

    def begin(self, conversation: Conversation, timeout_s: float) -> None:
        """Registers a conversation and steps until its first handshake is done, or the timeout over."""
        end_ns = self.now_ns() + round(timeout_s * 1e9)
        self._due_ns[conversation] = self.now_ns()
        while not conversation.settled and self.now_ns() < end_ns:
            self._advance(end_ns)

    def end(self, conversation: Conversation) -> None:
        """Steps until a conversation that was told to stop has ended; returns at once if it has."""
        if conversation in self._due_ns:
            self._due_ns[conversation] = min(self.now_ns(), self._due_ns[conversation])
        while conversation in self._due_ns:
            self._advance(self.now_ns() + self._step_ns)

    def deliver(self) -> None:
        """Has every participant of a CAN bus take the frames that wait for it, and answer, until none waits;
        does nothing when called from within itself.
        """
        if self._delivering:
            return
        self._delivering = taken = True
        while taken:
            taken = False
            for bus in list(self.buses):
                if bus.waiting and bus.taken is not None:
                    bus.taken()
                    taken = True
            for network in self.networks:
                while getattr(network._bus, "waiting", None) and network.receive(0.0):
                    taken = True
        self._delivering = False


class SerialLine:
    """A serial port with an emulated device behind it. Bytes take their time on the wire.

    Attributes:
        plugged: whether the port is there; `silent`: whether the device neither hears nor is heard.
        sent: what the driver wrote, with its time in s.
    """

    def __init__(self, time: SteppedTime, device: EmulatedDevice, baud: int, port: str = "memory") -> None:
        self.device, self.port = device, port
        self.plugged, self.silent, self.opened = True, False, False
        self.sent: list[tuple[float, bytes]] = []
        self.to_device, self.to_host = Wire(baud), Wire(baud)
        self._time = time
        time.lines[port] = self
        time.devices.append(self.live)

    def live(self, t_s: float) -> None:
        """Advances the device to `t_s` and carries the bytes both ways; while silent all are dropped, while
        unplugged those to the host.
        """
        arrived = self.to_device.arrived(t_s)
        if arrived and not self.silent:
            self.device.receive(arrived, t_s)
        sent = self.device.advance(t_s)
        if self.plugged and not self.silent:
            self.to_host.send(sent, t_s)

    def arrived(self, t_s: float) -> bytes:
        return self.to_host.arrived(t_s)

    def read(self, timeout_s: float) -> bytes:
        """Returns the bytes that have arrived; waits for them up to `timeout_s` of stepped time, while the
        devices live; empty if none came. DeviceError: unplugged.
        """
        until_ns = self._time.now_ns() + round(timeout_s * 1e9)
        while True:
            if not self.plugged:
                raise DeviceError(f"{self.port}: gone while reading")
            data = self.arrived(self._time.t_s)
            if data or self._time.now_ns() >= until_ns:
                return data
            self._time._live_until(self._time.now_ns() + self._time._step_ns)

    def write(self, data: bytes) -> None:
        if not self.plugged:
            raise DeviceError(f"{self.port}: gone while writing")
        self.sent.append((self._time.t_s, data))
        self.to_device.send(data, self._time.t_s)


class SteppedCanBus(can.BusABC):
    """A participant of the CAN bus.

    Attributes:
        taken: takes the frames that wait, where it is no network that does; `gone`: whether it is unplugged.
    """

    def __init__(self, time: SteppedTime, channel: str) -> None:
        self.waiting = deque[can.Message]()
        self.taken: Callable[[], object] | None = None
        self.gone = False
        self.channel, self._time = channel, time
        self.channel_info, self._can_protocol = channel, can.CanProtocol.CAN_20
        super().__init__(channel)
        time.buses.append(self)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Queues a frame for each other plugged participant of the channel, and has it taken at once;
        `timeout` does not count. CanOperationError: unplugged.
        """
        if self.gone:
            raise can.CanOperationError(f"{self.channel}: gone while writing")
        for other in self._time.buses:
            if other is not self and other.channel == self.channel and not other.gone:
                other.waiting.append(msg)
        self._time.deliver()

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if self.gone:
            self.waiting.clear()
            raise can.CanOperationError(f"{self.channel}: gone while reading")
        return (self.waiting.popleft() if self.waiting else None), False

    def shutdown(self) -> None:
        super().shutdown()
        self.waiting.clear()
        if self in self._time.buses:
            self._time.buses.remove(self)


def _call(one: object, function: Callable[..., object], *more: object) -> object:
    return function(one, *more)


@contextmanager
def stepped(step_ns: int = 1_000_000) -> Iterator[SteppedTime]:
    """Replaces threads, serial ports and CAN buses of every driver that is opened in the block by ones in
    memory, in stepped time; gives the time, by whose `lines` and `buses` they are found.
    """
    time = SteppedTime(step_ns)

    def open_serial(stream: Any, settings: SerialSettings, timeout_s: float = 0.02) -> None:  # noqa: ANN401
        """Stands in for `SerialStream.__init__`, `stream` its self: joins it to the line of that port in
        memory, whose bytes so far are dropped; `timeout_s` is of later reads. DeviceSetupError: no such line,
        unplugged, or open.
        """
        line = time.lines.get(settings.port)
        if line is None or not line.plugged:
            raise DeviceSetupError(
                f"{settings.port}: no such port; expected one that `forefeel devices` lists"
            )
        if line.opened:
            raise DeviceSetupError(f"{settings.port}: busy, another process holds it")
        line.arrived(time.t_s)  # a port is flushed when it is opened
        line.opened, stream.name, stream.timeout_s, stream.line = True, settings.port, timeout_s, line

    def open_bus(settings: CanSettings) -> can.BusABC:
        """Joins the bus of that channel in memory. DeviceSetupError: no emulated device is on it."""
        if all(bus.channel != settings.channel for bus in time.buses):
            raise DeviceSetupError(
                f"{settings.channel}: no such port; expected one that `forefeel devices` lists"
            )
        return SteppedCanBus(time, settings.channel)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Conversation, "_begin", partialmethod(_call, time.begin))
        patch.setattr(Conversation, "_end", partialmethod(_call, time.end))
        patch.setattr(SharedNetwork, "start", partialmethod(_call, time.networks.append))
        patch.setattr("forefeel.devices.canopen.network.open_bus", open_bus)
        patch.setattr("forefeel.devices.canopen.bus.open_bus", lambda can: SteppedCanBus(time, can.channel))
        patch.setattr(canopen.sdo.client.SdoClient, "RESPONSE_TIMEOUT", 1e-3)
        patch.setattr(SerialStream, "__init__", open_serial)
        patch.setattr(SerialStream, "read", lambda stream: stream.line.read(stream.timeout_s))
        patch.setattr(SerialStream, "write", lambda stream, data: stream.line.write(data))
        patch.setattr(SerialStream, "close", lambda stream: setattr(stream.line, "opened", False))
        yield time


class EmulatedBench:
    """A driver and its emulated device, in stepped time.

    Attributes:
        settings: of the driver; `missing`: the same with a port that does not exist.
    """

    def __init__(self, driver: InstalledDriver, folder: Path, time: SteppedTime, leave: ExitStack) -> None:
        emulation: Emulation = imported(str(driver.driver.emulator))
        port = str(folder / "host")
        self.driver, self.time = driver, time
        self.settings: DriverSettings = emulation.settings(driver, port)
        self.missing: DriverSettings = emulation.settings(driver, str(folder / "nothing_here"))
        self.around = Surroundings(preset("catheter"), None, seed=0, now_s=lambda: time.t_s)
        built = emulation.build(self.settings, self.around, leave)
        self.line: SerialLine | None = None
        self.on_can = emulation.on_can
        self.device = built
        if isinstance(built, SerialBench):
            self.device = built.device
            self.line = SerialLine(time, built.device, built.baud, port)
        else:
            connect(time, built)

    def make(self, settings: DriverSettings | None = None) -> Any:  # noqa: ANN401 - the port of its slot
        return self.driver.make(settings or self.settings, self.time)

    @contextmanager
    def opened(self) -> Iterator[Any]:
        """Makes and opens a new driver for the length of the block; closes it, also if the opening fails."""
        device = self.make()
        try:
            device.open()
            yield device
        finally:
            device.close()

    def plug(self, plugged: bool) -> None:
        """Plugs the cable between host and emulated device in, or pulls it: serial line, CAN networks, or,
        for another device, its faults `plug` and `unplug`.
        """
        if self.line is not None:
            self.line.plugged = plugged
        elif self.on_can:
            for network in self.time.networks:
                vars(network._bus)["gone"] = not plugged
        else:
            self.device.provoke("plug" if plugged else "unplug")

    @contextmanager
    def silent(self) -> Iterator[None]:
        """Silences the emulated device within the block: it neither receives nor sends; one without serial
        line or CAN bus stands still.
        """
        living = list(self.time.devices)
        if self.line is not None:
            self.line.silent = True
        elif self.on_can:
            self.device.provoke("unplug")
        else:
            self.time.devices.clear()
        yield
        self.time.devices[:] = living
        if self.line is not None:
            self.line.silent = False
        elif self.on_can:
            self.device.provoke("plug")


def connect(time: SteppedTime, device: Any) -> None:  # noqa: ANN401 - what has `step`
    """Has an emulated device without serial port called (its `step`) at each step of the time, and one on a
    CAN bus when frames wait for it, too.
    """

    def step(_t_s: float = 0.0) -> None:
        device.step(0.0)

    time.devices.append(step)
    bus = getattr(device, "_bus", None)
    if isinstance(bus, SteppedCanBus):
        bus.taken = step


class DriverContract:
    """Contract of every driver. Subclass the one of the slot, with the driver's name."""

    driver: ClassVar[str]
    slot: ClassVar[Slot]
    noticed_s: ClassVar[float] = 1.0
    """s until a silent device is a fault."""

    def installed(self) -> InstalledDriver:
        return installed_driver(self.slot, self.driver)

    @pytest.fixture
    def bench(self, tmp_path: Path) -> Iterator[EmulatedBench]:
        with stepped() as time, ExitStack() as leave:
            yield EmulatedBench(self.installed(), tmp_path, time, leave)

    def read(self, bench: EmulatedBench, device: Any) -> list[Any]:  # noqa: ANN401
        """Readings that the control loop gets at a tick."""
        return [device.read(bench.time.now_ns())]

    def test_open_connects_and_close_is_idempotent(self, bench: EmulatedBench) -> None:
        """Requires READY after `open`, no error at a second `close`, and ForefeelError at a read after."""
        device = bench.make()
        device.open()
        assert device.link.state is LinkState.READY
        device.close()
        device.close()
        with pytest.raises(ForefeelError):
            self.read(bench, device)

    def test_missing_port_is_refused_in_one_line(self, bench: EmulatedBench) -> None:
        device = bench.make(bench.missing)
        with pytest.raises(ForefeelError) as refused:
            device.open()
        device.close()
        assert "\n" not in str(refused.value)

    def test_silent_device_is_a_fault_until_rearmed(self, bench: EmulatedBench) -> None:
        with bench.opened() as device:
            with bench.silent():
                self.require_fault(bench, device)
            self.require_recovery(bench, device)

    def test_unplugged_device_is_a_fault_until_rearmed(self, bench: EmulatedBench) -> None:
        with bench.opened() as device:
            bench.plug(False)
            self.require_fault(bench, device)
            bench.plug(True)
            self.require_recovery(bench, device)

    def require_fault(self, bench: EmulatedBench, device: Any) -> None:  # noqa: ANN401
        """Reads until the driver raises ForefeelError; AssertionError: not within `noticed_s`, or the link
        does not wait for `rearm`.
        """

        def failed() -> bool:
            try:
                self.read(bench, device)
            except ForefeelError:
                return True
            return False

        bench.time.run_until(failed, self.noticed_s)
        assert device.link.inhibited is not None, "a fault has to wait for rearm"

    def require_recovery(self, bench: EmulatedBench, device: Any) -> None:  # noqa: ANN401
        """Waits until a faulty driver is connected again by itself and requires ForefeelError at a read; then
        calls `rearm`, and requires a read 0.5 s later to succeed. A link without a fault is only rearmed and
        read.
        """
        if device.link.inhibited is not None:
            bench.time.run_until(lambda: device.link.state is LinkState.CONFIGURED)
            with pytest.raises(ForefeelError):
                self.read(bench, device)
        device.rearm()
        bench.time.run(0.5)
        self.read(bench, device)


class StageContract(DriverContract):
    """A stage: finite positions, setpoints that are followed, rest by itself."""

    slot = "stage"
    way_m: ClassVar[float] = 0.001
    speed_m_s: ClassVar[float] = 0.005
    lead_s: ClassVar[float] = 0.1
    """s of motion that may be under way when the setpoints end."""

    def test_setpoint_that_is_no_number_is_refused(self, bench: EmulatedBench) -> None:
        with bench.opened() as stage, pytest.raises(DeviceError):
            stage.command(float("nan"), 0.0, bench.time.now_ns())

    def test_stage_follows_and_comes_to_rest(self, bench: EmulatedBench) -> None:
        """Requires a stage that is led over `way_m` at `speed_m_s` to end there, 0.2 mm off or `lead_s` of
        motion beyond at most, and to move less than 20 um in 0.2 s after it has rested for 0.5 s.
        """
        time = bench.time
        with bench.opened() as stage:
            start_m, begun_ns = stage.read(time.now_ns()).position_m, time.now_ns()

            def follow(now_ns: int) -> None:
                gone_m = self.speed_m_s * (now_ns - begun_ns) * 1e-9
                stage.command(start_m + gone_m, self.speed_m_s, now_ns)

            time.tick = follow
            time.run(self.way_m / self.speed_m_s)
            time.tick = lambda now_ns: None
            time.run(0.5)
            rest_m = stage.read(time.now_ns()).position_m
            time.run(0.2)
            moved_m = rest_m - start_m
            assert -2e-4 <= moved_m - self.way_m <= 2e-4 + self.speed_m_s * self.lead_s
            assert isfinite(rest_m) and abs(stage.read(time.now_ns()).position_m - rest_m) < 2e-5


class LoadCellContract(DriverContract):
    """A load cell: every reading once, at its rate, in newtons, and none believed that is no measurement."""

    slot = "load_cell"
    noticed_s = 3.0
    load_n: ClassVar[float] = 1.0
    distrusted: ClassVar[tuple[str, ...]] = ("stuck", "overrange")
    """Faults of the emulated device after which its readings are not valid."""

    def read(self, bench: EmulatedBench, device: Any) -> list[Any]:  # noqa: ANN401
        return list(device.read(bench.time.now_ns(), None))

    def require_fault(self, bench: EmulatedBench, device: Any) -> None:  # noqa: ANN401
        """Reads until the driver raises, or has no new valid reading for `stale_s`, at least 0.2 s;
        AssertionError: neither within `noticed_s`.
        """
        newest_ns = bench.time.now_ns()

        def failed() -> bool:
            """Reads once: True if that raises, or the newest valid reading is older than `stale_s`, at least
            0.2 s.
            """
            nonlocal newest_ns
            try:
                readings = self.read(bench, device)
            except ForefeelError:
                return True
            newest_ns = max([newest_ns, *(reading.stamp_ns for reading in readings if reading.valid)])
            return bool(bench.time.now_ns() - newest_ns > max(device.stale_s, 0.2) * 1e9)

        bench.time.run_until(failed, self.noticed_s)

    def readings(self, bench: EmulatedBench, cell: Any, seconds: float) -> list[Any]:  # noqa: ANN401
        """The readings of that time from now."""
        self.read(bench, cell)
        bench.time.run(seconds)
        return self.read(bench, cell)

    def test_reading_comes_once_at_its_rate(self, bench: EmulatedBench) -> None:
        """Requires of the readings of 1 s that their stamps increase, none lies after now, and their rate is
        that of the settings within 20 %.
        """
        with bench.opened() as cell:
            stamps_ns = [reading.stamp_ns for reading in self.readings(bench, cell, 1.0)]
        assert all(after > before for before, after in pairwise(stamps_ns))
        assert stamps_ns[-1] <= bench.time.now_ns()
        rate_hz = (len(stamps_ns) - 1) * 1e9 / (stamps_ns[-1] - stamps_ns[0])
        assert rate_hz == pytest.approx(getattr(bench.settings, "rate_hz", rate_hz), rel=0.2)

    def test_load_is_read_with_sign_and_value(self, bench: EmulatedBench) -> None:
        with bench.opened() as cell:
            empty_n = self.mean_n(bench, cell)
            bench.around.load.force_n = self.load_n
            bench.time.run(0.2)
            assert self.mean_n(bench, cell) - empty_n == pytest.approx(self.load_n, rel=0.05)

    def mean_n(self, bench: EmulatedBench, cell: Any) -> float:  # noqa: ANN401
        forces_n = [reading.force_n for reading in self.readings(bench, cell, 0.5) if reading.valid]
        return float(sum(forces_n) / len(forces_n))

    def test_fault_of_the_cell_is_not_believed(self, bench: EmulatedBench) -> None:
        """Requires that each fault of `distrusted` makes a reading invalid within 3 s of stepped time, and
        that a valid one comes within 3 s after its end.
        """
        with bench.opened() as cell:
            for fault in self.distrusted:
                bench.time.run(1.0)  # it must have been seen to be noisy before it can stick
                bench.device.provoke(fault)
                bench.time.run_until(lambda: any(not one.valid for one in self.read(bench, cell)), 3.0)
                bench.device.provoke("free")
                bench.time.run_until(lambda: any(one.valid for one in self.read(bench, cell)), 3.0)


class HandleContract(DriverContract):
    """A handle: the force that it says it gives, and none when it is closed."""

    slot = "handle"
    force_n: ClassVar[float] = 0.3

    def test_rendered_force_is_that_which_was_asked(self, bench: EmulatedBench) -> None:
        """Requires that `render`, after 0.1 s of calls, gives a force above 0 N, at most the one asked."""
        applied_n: list[float] = []
        with bench.opened() as handle:
            bench.time.tick = lambda now_ns: applied_n.append(handle.render(self.force_n, now_ns))
            bench.time.run(0.1)
            bench.time.tick = lambda now_ns: None
        assert 0.0 < applied_n[-1] <= self.force_n + 1e-9
