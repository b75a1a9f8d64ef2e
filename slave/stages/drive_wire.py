"""What is heard of a CiA 402 drive, and what it is sent at every cycle."""

from collections.abc import Callable

from forefeel.common.clock import Clock
from forefeel.common.errors import DeviceError
from forefeel.common.hardware import cia402
from forefeel.common.hardware.can_network import HOST_NODE, SharedNetwork
from forefeel.common.hardware.cia301 import EMERGENCY, HEARTBEAT, OPERATIONAL, SYNC, emergency
from forefeel.common.hardware.link import DeviceLink
from forefeel.slave.stages.cia402_setup import command_pdo, state_pdo
from forefeel.slave.stages.drive_cycle import Readback
from forefeel.slave.stages.settings import Cia402Settings

_RANK = 1  # a drive's SYNC goes before a load cell's

Believe = Callable[[int, int, float], Readback | None]
"""A TPDO (host_ns, statusword, position in counts) as it is to be taken; None: it can not be true."""


class DriveEars:
    """What the receiving thread hears of one drive; every part is taken once. Use: `with ears:`."""

    def __init__(
        self, shared: SharedNetwork, node: int, link: DeviceLink, clock: Clock, believe: Believe
    ) -> None:
        self._shared, self._link, self._clock, self._believe = shared, link, clock, believe
        self._pdo = state_pdo(node)
        self._hears = (
            (self._pdo.can_id, self._on_state),
            (HEARTBEAT + node, self._on_heartbeat),
            (EMERGENCY + node, self._on_emergency),
        )
        self._heard: Readback | None = None
        self._beat = False
        self._emergency: int | None = None

    def __enter__(self) -> "DriveEars":
        for can_id, heard in self._hears:
            self._shared.subscribe(can_id, heard)
        return self

    def __exit__(self, *_: object) -> None:
        for can_id, heard in self._hears:
            self._shared.unsubscribe(can_id, heard)

    def take(self) -> tuple[Readback | None, bool, int | None]:
        """State, heartbeat and emergency since the last call."""
        found = self._heard, self._beat, self._emergency
        self._heard, self._beat, self._emergency = None, False, None
        return found

    def _on_state(self, can_id: int, data: bytearray, stamp: float) -> None:
        del can_id, stamp
        values = self._pdo.unpack(data)
        counters = self._link.counters
        counters["tpdos"] += 1
        if values is None:
            counters["bad_length"] += 1
            return
        heard = self._believe(self._clock.now_ns(), int(values[0]), values[1])
        if heard is None:
            counters["implausible"] += 1
            return
        self._heard = heard

    def _on_heartbeat(self, can_id: int, data: bytearray, stamp: float) -> None:
        del can_id, stamp
        self._beat = self._beat or data[:1] == bytes([OPERATIONAL])

    def _on_emergency(self, can_id: int, data: bytearray, stamp: float) -> None:
        del can_id, stamp
        self._link.counters["emergencies"] += 1
        self._emergency = emergency(data) or self._emergency


class DriveVoice:
    """Controlword and target, SYNC after it, and our heartbeat; from one thread.

    Attributes:
        asked_ns: when the newest SYNC of ours went out.
    """

    def __init__(self, shared: SharedNetwork, settings: Cia402Settings, link: DeviceLink) -> None:
        self._shared, self._link = shared, link
        self._pdo = command_pdo(settings.node_id)
        self.period_ns = round(1e9 / settings.sync_hz)
        self._beat_ns, self._next_beat_ns = round(settings.heartbeat_s * 1e9), 0
        self.asked_ns: int | None = None

    def send(self, word: int, target: int, now_ns: int) -> None:
        """One cycle.

        Raises:
            DeviceError: the bus failed.
        """
        self._shared.send(self._pdo.can_id, self._pdo.pack(word, target))
        if self._shared.sends_sync(self, _RANK):
            self.asked_ns = now_ns
            self._shared.send(SYNC, b"")
        if now_ns >= self._next_beat_ns:
            self._next_beat_ns = now_ns + self._beat_ns - self.period_ns // 2
            self._shared.send(HEARTBEAT + HOST_NODE, bytes([OPERATIONAL]))

    def tell(self) -> None:
        """What became of the bus' frames stands in the link's counters."""
        self._shared.tell(self._link)

    def release(self, target: int, now_ns: int) -> None:
        """Quick stop, as far as the bus still carries it; silence does the same three heartbeats later."""
        try:
            for _ in range(2):
                self.send(cia402.QUICK_STOP, target, now_ns)
        except DeviceError:
            self._link.counters["quick_stop_failed"] += 1
        finally:
            self._shared.leave_sync(self)
