"""Calibration of a Zaber stage: homes it and runs over its travel. Blocks while it moves."""

from types import TracebackType

from forefeel.common.clock import Clock, MonotonicClock
from forefeel.common.errors import DeviceError
from forefeel.common.hardware.link import DeviceLink, LinkState
from forefeel.devices.shared.stream import SerialStream
from forefeel.devices.zaber.driver import ConfiguredStage, clear_faults, connect, link_name
from forefeel.devices.zaber.protocol import SPEED_DATA, UNHOMED, in_words, is_fault
from forefeel.devices.zaber.settings import ZaberSettings


class ZaberHoming:
    """Homing of a stage, with or without a reference. Use: `with ZaberHoming(settings) as homing:`.

    Whatever ends the block, the stage is told to stop. The calibration in the settings is ignored.

    Attributes:
        link: identity and counters.
        native_per_m: microsteps per m.
    """

    def __init__(self, settings: ZaberSettings, clock: Clock | None = None) -> None:
        self._settings = settings.model_copy(update={"calibration": None})
        self._clock = clock or MonotonicClock()
        self.link = DeviceLink(link_name(settings))
        self._stream: SerialStream | None = None
        self._device: ConfiguredStage | None = None
        self.native_per_m = 0.0

    def __enter__(self) -> "ZaberHoming":
        self._stream = SerialStream(self._settings)
        try:
            self.link.advance(LinkState.OPEN)
            self._device = connect(self._settings, self._clock, self.link, self._stream)
            self.native_per_m = abs(self._device.scale.per_m)
            clear_faults(self._device.talk, self.link)
        except BaseException:
            self._stream.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        assert self._stream is not None
        try:
            self._post_stop()
        finally:
            self._stream.close()

    def home(self, timeout_s: float = 60.0) -> float:
        """Homes; returns the position of home in microsteps.

        Raises:
            DeviceError: a fault on the way, or not there in time; the stage is told to stop.
        """
        self._move("home", timeout_s)
        return self._opened().talk.number("get pos")

    def travel_ends(self, velocity_m_s: float, timeout_s: float = 120.0) -> tuple[float, float]:
        """Runs to both limits of the device, no faster than that, and stays at the lower one. Returns (lower,
        upper) in microsteps; the maximum speed is as before at the end.

        Raises:
            DeviceError: as `home`.
        """
        talk = self._opened().talk
        usual = talk.number("get maxspeed")
        talk.ask(f"set maxspeed {max(1, int(min(usual, velocity_m_s * self.native_per_m * SPEED_DATA)))}")
        try:
            self._move("move max", timeout_s)
            high = talk.number("get pos")
            self._move("move min", timeout_s)
            return talk.number("get pos"), high
        except BaseException:
            self._post_stop()  # first: a stage whose answers are lost is asked for a second
            raise
        finally:
            talk.ask(f"set maxspeed {int(usual)}")

    def _move(self, text: str, timeout_s: float) -> None:
        """Sends the command of a motion and waits until the stage is idle. A stage that is not homed may
        move. DeviceError: a rejection, a fault on the way, or too long, after which it is stopped.
        """
        talk = self._opened().talk
        talk.ask(text)
        until_ns = self._clock.now_ns() + int(timeout_s * 1e9)
        while self._clock.now_ns() < until_ns:
            (reply,) = talk.exchange([""])
            if reply is None:
                continue
            flag = talk.accepted(text, reply.value).warning
            if is_fault(flag) and flag not in UNHOMED:
                raise DeviceError(f"{self.link.name}: {in_words(flag)} during {text!r}")
            if not reply.value.busy:
                return
        talk.ask("stop")
        raise DeviceError(f"{self.link.name}: {text!r} takes too long; the stage has been stopped")

    def _post_stop(self) -> None:
        """Sends a stop, and waits for no answer; counts one that can not be sent."""
        try:
            self._opened().talk.post(["stop"])
        except DeviceError:
            self.link.counters["stops_not_sent"] += 1

    def _opened(self) -> ConfiguredStage:
        if self._device is None:
            raise DeviceError(f"{self.link.name}: used while closed, expected a `with` block")
        return self._device
