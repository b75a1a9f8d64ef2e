"""CANopen networks that the drivers of one process share: one for each bus, counted."""

from collections import Counter
from collections.abc import Callable
from threading import Event, Lock, Thread

import can
import canopen

from forefeel.common.errors import DeviceError, DeviceSetupError
from forefeel.common.hardware.link import DeviceLink
from forefeel.devices.canopen.bus import open_bus
from forefeel.devices.canopen.slcan import SlcanBus
from forefeel.devices.shared.settings import CanSettings

HOST_NODE = 127  # identifier of our heartbeat, the largest there is; no device may have it (`NodeId`)
_RECEIVE_S = 0.05  # s between two looks for an end: `close` waits for as long
_BUS_OFF = 0x40  # CAN_ERR_BUSOFF of Linux' error frames

Handler = Callable[[int, bytearray, float], None]


class SharedNetwork:
    """One bus, its receiving thread and the network on it; `acquire` gives it, `release` lets it go.

    A bus that failed stays so: who acquires it next gets a new one.

    Attributes:
        network: canopen's; nodes are added by their drivers.
        failed: why the bus is gone; None while it works.
        counters: `error_frames`, `callback_errors`.
    """

    def __init__(self, settings: CanSettings) -> None:
        self.settings = settings
        self.name = f"{settings.interface} {settings.channel}"
        self.failed: str | None = None
        self.counters: Counter[str] = Counter()
        self.users = 1
        self._reported: dict[DeviceLink, Counter[str]] = {}
        self._bus = open_bus(settings)
        self.network = canopen.Network(self._bus)
        self._sync: tuple[object, int] | None = None
        self._sync_lock, self._stopping = Lock(), Event()
        self._thread = Thread(target=self._run, name=f"receiver of {self.name}", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def send(self, can_id: int, data: bytes) -> None:
        """Sends one frame. DeviceError: the bus failed, now or before; it stays failed."""
        self.check()
        try:
            self.network.send_message(can_id, data)
        except (can.CanError, OSError, RuntimeError) as error:
            self._fail(error)
            self.check()

    def check(self) -> None:
        if self.failed is not None:
            where = "" if self.settings.channel in self.failed else f"{self.name}: "
            raise DeviceError(f"{where}{self.failed}")

    def subscribe(self, can_id: int, handler: Handler) -> None:
        """Has `handler(can_id, data, stamp)` called in the receiving thread."""
        self.network.subscribe(can_id, handler)

    def unsubscribe(self, can_id: int, handler: Handler) -> None:
        """Ends a subscription; nothing when there is none."""
        if handler in self.network.subscribers.get(can_id, ()):
            self.network.unsubscribe(can_id, handler)

    def sends_sync(self, owner: object, rank: int) -> bool:
        """Gives SYNC to the first owner that asks, then to one of higher rank; true for who has it."""
        with self._sync_lock:
            if self._sync is None or rank > self._sync[1]:
                self._sync = owner, rank
            return self._sync[0] is owner

    def leave_sync(self, owner: object) -> None:
        with self._sync_lock:
            if self._sync is not None and self._sync[0] is owner:
                self._sync = None

    def update_counters(self, link: DeviceLink) -> None:
        """Adds what was counted since the last call for this link to its counters, as `bus_...`."""
        lines = self._bus.counts if isinstance(self._bus, SlcanBus) else Counter[str]()
        counts = lines + self.counters
        for name, count in (counts - self._reported.get(link, Counter())).items():
            link.counters[f"bus_{name}"] += count
        self._reported[link] = counts

    def close(self) -> None:
        """Ends the receiving thread, within 50 ms, and closes the bus; an error of that goes to `failed`."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join(5.0)
        try:
            self._bus.shutdown()
        except (can.CanError, OSError) as error:
            self._fail(error)

    def _run(self) -> None:
        while not self._stopping.is_set() and self.receive(_RECEIVE_S):
            pass

    def receive(self, timeout_s: float) -> bool:
        """Waits for a frame and passes it to its subscribers; False when receiving failed, True even if none
        came. Remote frames are dropped, error frames and exceptions of subscribers counted; bus off sets
        `failed`.
        """
        try:
            message = self._bus.recv(timeout_s)
        except (can.CanError, OSError, ValueError) as error:
            self._fail(error)
            return False
        if message is None or message.is_remote_frame:
            return True
        if message.is_error_frame:
            self.counters["error_frames"] += 1
            if message.arbitration_id & _BUS_OFF:
                self.failed = self.failed or "bus off"
            return True
        try:
            self.network.notify(message.arbitration_id, message.data, message.timestamp)
        except Exception:  # noqa: BLE001 - what a frame does to its receiver does not end reception
            self.counters["callback_errors"] += 1
        return True

    def _fail(self, error: BaseException) -> None:
        self.failed = self.failed or (" ".join(str(error).split())[:160] or type(error).__name__)


_networks: dict[tuple[str, str], SharedNetwork] = {}
_lock = Lock()


def acquire(settings: CanSettings) -> SharedNetwork:
    """Shares the network that has the bus open; opens it anew where none has, or that one has failed.
    `release` it once for each call. DeviceSetupError: it can not be opened, or has another bitrate.
    """
    key = settings.interface, settings.channel
    with _lock:
        known = _networks.get(key)
        if known is None or known.failed is not None:
            known = _networks[key] = SharedNetwork(settings)
            known.start()
            return known
        if known.settings.bitrate != settings.bitrate:
            raise DeviceSetupError(
                f"{known.name}: bitrate = {settings.bitrate}: expected {known.settings.bitrate}, "
                "as of the other devices on it"
            )
        known.users += 1
        return known


def release(shared: SharedNetwork) -> None:
    """Ends one use of the network; the last one closes the bus, and the next `acquire` opens it anew."""
    with _lock:
        shared.users -= 1
        if shared.users:
            return
        for key, known in list(_networks.items()):
            if known is shared:
                del _networks[key]
    shared.close()
