"""Calibration of a CiA 402 drive: homes it and runs over its travel. Blocks while it moves."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import TracebackType

from forefeel.common.clock import MonotonicClock, SleepingClock
from forefeel.common.errors import DeviceError
from forefeel.devices.canopen.cia301 import ENTER_PREOPERATIONAL
from forefeel.devices.canopen.network import SharedNetwork, acquire, release
from forefeel.devices.canopen.sdo import RemoteDevice, can_link, talking_to
from forefeel.devices.cia402 import protocol as cia402
from forefeel.devices.cia402.driver import (
    STAND_CYCLES,
    Cia402Stage,
    DriveCycle,
    DriveWire,
    Readback,
    configure_homing,
    require_homing,
)
from forefeel.devices.cia402.protocol import (
    HERE,
    HOMING_ATTAINED,
    HOMING_ERROR,
    HOMING_START,
    TARGET_REACHED,
    Phase,
)
from forefeel.devices.cia402.settings import Cia402Settings
from forefeel.devices.shared.conversation import Pacer
from forefeel.devices.shared.stage import PositionScale, Setpoint

# --- One cycle of a drive that is being homed. Pure.
_ANSWER_CYCLES = 3  # readbacks after the start that are not judged, for they may be older than it
_STATUS = HOMING_ERROR | HOMING_ATTAINED | TARGET_REACHED


class HomingCycle:
    """Enables the drive, starts homing, and judges from the statusword how it ends.

    A drive may show that it is homed from the last time, until it has taken the start: where something has to
    move, `done` needs a statusword that said it was not.

    Args:
        cycle: supervision of the drive; its setpoint stays where the drive is.
        method: of 6098.
        patience: cycles that homing may take.

    Attributes:
        done: whether the reference has been found, and the drive is at rest.
    """

    def __init__(self, cycle: DriveCycle, method: int, patience: int) -> None:
        self.done = False
        self._cycle, self._left = cycle, patience
        self._begun = method in HERE
        self._moving = False
        self._started = 0

    def step(self, readback: Readback | None, beat: bool, emergency: int | None) -> int:
        """Returns the controlword of this cycle: enables the drive, then homes it; sets `done` at the end.
        DeviceError: a fault of the drive or of the way to it, of homing, or no end in time.
        """
        machine = self._cycle.machine
        word = self._cycle.supervise(readback, beat, emergency)
        if readback is not None:
            self._cycle.setpoint.restart(readback.position_m)
            self._cycle.passive_cycles += machine.phase is Phase.PASSIVE
        if machine.phase is not Phase.FOLLOWING:
            if self._cycle.passive_cycles >= STAND_CYCLES:
                machine.enable()
            return word
        if self._started and readback is not None:
            self._started += 1
            self._judge(readback.statusword)
        self._started = self._started or 1
        self._left -= 1
        if self._left < 0 and not self.done:
            raise DeviceError("homing takes too long")
        return word | HOMING_START

    def _judge(self, statusword: int) -> None:
        """Sets `done` when the statusword says that homing is attained and at rest; not in the first cycles.
        DeviceError: the drive reports an error of homing, or it was interrupted.
        """
        status = statusword & _STATUS
        self._begun = self._begun or not status & HOMING_ATTAINED
        self._moving = self._moving or status == 0
        if self._started <= _ANSWER_CYCLES:
            return
        if status & HOMING_ERROR:
            raise DeviceError(f"the drive reports an error of homing (statusword {statusword:04X})")
        if status == TARGET_REACHED and self._moving:
            raise DeviceError(f"homing was interrupted (statusword {statusword:04X})")
        self.done = self._begun and status == HOMING_ATTAINED | TARGET_REACHED


# --- The calibration.
_REACH_M = 20e-6  # m beyond an end of the travel to which it is sent, so that it has been there
_AT_REST_S = 0.1  # s for which it must stay where it was sent
_EXTRA_S = 10.0  # s beyond twice the time of the motion itself before it is given up
_OFF_SWITCH_M = 0.01  # m, longest way off a switch at `zero_velocity_m_s`, for the time that homing may take


class Cia402Homing:
    """Homes a CiA 402 drive and runs over its travel. To a target it goes in cyclic synchronous position
    mode, under the same supervision as in service; between two motions the drive stands in quick stop.

    Attributes:
        link: identity and counters.
    """

    def __init__(self, settings: Cia402Settings, clock: SleepingClock | None = None) -> None:
        self._settings = settings.model_copy(update={"calibration": None})
        self._clock = clock or MonotonicClock()
        self.link = can_link("stage", settings.driver, settings.can, settings.node_id)
        self._bus: SharedNetwork | None = None
        self._per_m = settings.sign * settings.counts_per_m
        self._scale: PositionScale | None = None
        self._at = 0.0

    def __enter__(self) -> "Cia402Homing":
        """Connects; nothing moves. DeviceSetupError: it can not be homed as the settings have it."""
        self._bus = acquire(self._settings.can)
        try:
            with self._device() as (_, device):
                require_homing(device, self._settings)
        except BaseException:
            release(self._bus)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Lets go: every motion has ended in a quick stop."""
        assert self._bus is not None
        release(self._bus)
        self.link.close()

    def home(self) -> float:
        """Homes, then moves into the travel; returns the position of x = 0 in counts. A method that moves
        nothing first goes to `home_m`, if the drive was homed here before.

        Raises:
            DeviceError: a fault on the way, or not there in time; the stage has been stopped.
        """
        homing = self._settings.homing
        if homing.method in HERE and self._scale is not None:
            self._go([homing.home_m], homing.search_velocity_m_s)
        with self._device() as (shared, device):
            configure_homing(device, self._settings)
            self._run(shared)
            device.order(ENTER_PREOPERATIONAL)
            offset, self._at = device.read(cia402.HOME_OFFSET, 0.0), device.read(cia402.POSITION_ACTUAL)
        self._require_new_count(offset)
        self._scale = PositionScale(offset - self._per_m * homing.home_m, self._per_m)
        low_m, high_m = self._settings.travel_m
        inside_m = max(low_m, min(high_m, self._scale.metres(self._at)))
        if self._scale.native(inside_m) != round(self._at):
            self._go([inside_m], homing.search_velocity_m_s)
        return self._scale.zero

    def travel_ends(self, velocity_m_s: float) -> tuple[float, float]:
        """Runs a little beyond both ends of `travel_m`; returns the counts there. Raises as `home`."""
        (low_m, high_m), reach_m = self._settings.travel_m, self._reach_m
        first, second = self._go([low_m - reach_m, high_m + reach_m], velocity_m_s)
        return first, second

    @property
    def _reach_m(self) -> float:
        return max(_REACH_M, 2.0 / self._settings.counts_per_m)

    @contextmanager
    def _device(self) -> Iterator[tuple[SharedNetwork, RemoteDevice]]:
        """Yields (network, device) of the identified drive for the length of a block. DeviceError: another
        serial number than before.
        """
        settings, serial = self._settings, self.link.serial
        self.link.begin()
        with talking_to(settings.can, settings.node_id, self.link) as (shared, device):
            device.identify(cia402.PROFILE)
            if serial not in ("", self.link.serial):
                raise DeviceError(f"{device.name}: another drive, serial {self.link.serial}")
            yield shared, device

    def _require_new_count(self, offset: float) -> None:
        """Raises DeviceError unless the count after homing is the home offset, within the following error."""
        off_m = abs(self._at - offset) / self._settings.counts_per_m
        if off_m > self._settings.following_error_m:
            raise DeviceError(
                f"{self.link.name}: at {self._at:g} counts after homing; expected its home offset (607C), "
                f"{offset:g}, within {self._settings.following_error_m:g} m"
            )

    # --- the mode of homing ---

    def _run(self, shared: SharedNetwork) -> None:
        """Runs the cycles of homing until it is done; a quick stop follows in any case. DeviceError: a fault,
        or no end in time.
        """
        settings, counts = self._settings, PositionScale(0.0, self._per_m)

        def decode(host_ns: int, statusword: int, native: float) -> Readback:
            return Readback(host_ns, statusword, counts.metres(native), 0.0)

        period_s = 1.0 / settings.sync_hz
        setpoint = Setpoint(period_s, settings.travel_m, settings.max_velocity_m_s, 1.0)
        cycle = DriveCycle(period_s, settings.heartbeat_s, setpoint)
        homing = HomingCycle(cycle, settings.homing.method, round(self._longest_s() * settings.sync_hz))
        try:
            with DriveWire(shared, settings, self.link, self._clock, decode, 0) as wire:
                pacer = Pacer(self._clock, wire.period_ns)
                while not homing.done:
                    word = homing.step(*wire.take())
                    wire.send(word, counts.native(cycle.setpoint.position_m))
                    self._sleep(pacer)
        except DeviceError as error:
            raise DeviceError(f"{self.link.name}: {error}; the stage has been stopped") from error

    def _sleep(self, pacer: Pacer) -> None:
        self._clock.sleep_until_ns(self._clock.now_ns() + round(pacer.wait_s() * 1e9))

    def _longest_s(self) -> float:
        """Time that homing may take: for twice the travel in search of the switch, and off it again."""
        (low_m, high_m), homing = self._settings.travel_m, self._settings.homing
        search_s = 2.0 * (high_m - low_m) / homing.search_velocity_m_s
        return _EXTRA_S + search_s + _OFF_SWITCH_M / homing.zero_velocity_m_s

    # --- the way from end to end ---

    def _go(self, targets_m: Sequence[float], velocity_m_s: float) -> list[float]:
        """Moves to one target after the other; returns its positions at rest in counts, and stores the last.

        The stage stays between where it is and where it is sent, and goes no faster than `velocity_m_s`.
        """
        assert self._scale is not None, "homed before"
        places_m = [self._scale.metres(self._at), *targets_m]
        bounds = {"travel_m": (min(places_m), max(places_m)), "max_velocity_m_s": velocity_m_s}
        stage = Cia402Stage(self._settings.model_copy(update=bounds), self._clock, self._scale)
        try:
            stage.open()
            rests = [self._reach(stage, target_m, velocity_m_s) for target_m in targets_m]
        finally:
            stage.close()
        self._at = rests[-1]
        return rests

    def _reach(self, stage: Cia402Stage, target_m: float, velocity_m_s: float) -> float:
        """Moves to a target, waits until the stage has been there for 0.1 s, and returns its position in
        counts. DeviceError: not there in twice the time of the motion and 10 s.
        """
        assert self._scale is not None, "homed before"
        clock, pacer = self._clock, Pacer(self._clock, 10_000_000)
        start_m = stage.read(clock.now_ns()).position_m
        left_s, rested_s = _EXTRA_S + 2.0 * abs(target_m - start_m) / velocity_m_s, 0.0
        while rested_s < _AT_REST_S:
            stage.command(target_m, 0.0, clock.now_ns())
            self._sleep(pacer)
            at_m = stage.read(clock.now_ns()).position_m
            rested_s = rested_s + 0.01 if abs(at_m - target_m) <= self._reach_m else 0.0
            left_s -= 0.01
            if left_s < 0.0:
                raise DeviceError(
                    f"{self.link.name}: at {at_m:.5f} m, expected to come to rest at {target_m:.5f} m; "
                    "the stage has been stopped"
                )
        return self._scale.zero + self._scale.per_m * at_m
