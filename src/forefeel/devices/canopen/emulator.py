"""An emulated CANopen device: canopen's LocalNode, and what it lacks: PDOs, SYNC, stepped heartbeats."""

import struct
import time
from collections.abc import Callable, Mapping

import can
import canopen
from canopen.objectdictionary import datatypes

from forefeel.devices.canopen import cia301
from forefeel.devices.canopen.cia301 import ObjectEntry

_TYPES = {
    "b": datatypes.INTEGER8,
    "h": datatypes.INTEGER16,
    "i": datatypes.INTEGER32,
    "B": datatypes.UNSIGNED8,
    "H": datatypes.UNSIGNED16,
    "I": datatypes.UNSIGNED32,
    "f": datatypes.REAL32,
}
# largest transmission type of a PDO that waits for SYNC: 0 acyclic, 1 to 240 at every n-th SYNC (CiA 301)
_MOST_SYNCHRONOUS = 240
_PDO_OFF = 1 << 31  # bit of a PDO's COB-ID: the PDO is not valid (CiA 301)
_PREOPERATIONAL = 127  # state in a heartbeat (CiA 301)
_MOST_FRAMES = 200  # frames that one round takes from the bus
Contents = Mapping[ObjectEntry, float]


def object_dictionary(contents: Contents) -> canopen.ObjectDictionary:
    """Builds canopen's object dictionary of these entries, their values as defaults. An index with
    sub-entries becomes a record. A client of the device can be given the dictionary, too.
    """
    dictionary = canopen.ObjectDictionary()
    for entry, value in contents.items():
        variable = canopen.objectdictionary.ODVariable(f"x{entry}", entry.index, entry.sub)
        variable.data_type = _TYPES[entry.kind]
        variable.default = value  # type: ignore[assignment]  # canopen takes reals, too
        if entry.sub == 0 and not any(e.index == entry.index and e.sub for e in contents):
            dictionary.add_object(variable)
            continue
        record = dictionary.indices.get(entry.index)
        if not isinstance(record, canopen.objectdictionary.ODRecord):
            record = canopen.objectdictionary.ODRecord(f"r{entry.index:04X}", entry.index)
            dictionary.add_object(record)
        record.add_member(variable)
    return dictionary


def common_contents(node: int, profile: int, serial: int) -> dict[ObjectEntry, float]:
    """Returns the objects of every device with their start values: identity, heartbeat, four PDOs each way.
    The PDOs are off and have their predefined identifiers.
    """
    objects: dict[ObjectEntry, float] = {
        cia301.DEVICE_TYPE: 0x0002_0000 | profile,
        cia301.ERROR_REGISTER: 0,
        cia301.HEARTBEAT_PRODUCER_MS: 0,
        ObjectEntry(0x1018, 0, "B"): 4,
        cia301.VENDOR: 0x0000_FEE1,
        cia301.PRODUCT: int(f"{profile}", 16),
        cia301.REVISION: 0x0001_0000,
        cia301.SERIAL: serial,
    }
    for transmit in (False, True):
        for number in range(1, 5):
            communication, mapping = cia301.pdo_objects(transmit, number)
            off, can_id = cia301.pdo_off(transmit, number, node)
            objects |= {ObjectEntry(communication, 0, "B"): 2, off: can_id}
            objects |= {ObjectEntry(communication, 2, "B"): 255, ObjectEntry(mapping, 0, "B"): 0}
            objects |= {ObjectEntry(mapping, i, "I"): 0 for i in range(1, 5)}
    return objects


class _Network(canopen.Network):
    muted = False

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        if not self.muted:
            super().send_message(can_id, data, remote)


class CanopenDevice:
    """A device on any python-can bus, in the thread that calls `step` over and over.

    Subclasses give `written` and `shown` their meaning.

    Args:
        bus: an open bus of its own.
        node: its identifier.
        contents: its object dictionary.
        now_s: a clock; the system's by default.

    Attributes:
        faults: what `provoke` takes.
    """

    faults: tuple[str, ...] = ("unplug", "plug")

    def __init__(
        self, bus: can.BusABC, node: int, contents: Contents, now_s: Callable[[], float] = time.monotonic
    ) -> None:
        self.node_id = node
        self._bus, self._clock, self._start_s = bus, now_s, now_s()
        self._network = _Network(bus)
        self._node = canopen.LocalNode(node, object_dictionary(contents))
        vars(self._node.nmt)["start_heartbeat"] = lambda period_ms: None  # canopen's has a thread
        self._beat_s = self._next_beat_s = 0.0
        self._node.add_write_callback(self._on_write)
        self._node.add_read_callback(self._on_read)
        self._network.add_node(self._node)
        self._network.subscribe(cia301.NMT, self._on_nmt)
        self._pdos: list[tuple[bool, int, int, tuple[tuple[int, int], ...]]] | None = None
        self._rpdos: dict[int, bytes] = {}
        self._syncs = 0
        self._boot()

    # --- for subclasses ---

    def written(self, index: int, sub: int, value: bytes) -> None:
        """An object was written, over SDO or by a PDO."""

    def shown(self, index: int, sub: int) -> float | None:
        """Value of an object that changes by itself; None: as it was written last."""
        del index, sub
        return None

    def synchronised(self, t_s: float) -> None:
        """SYNC: after the PDOs that were received are applied, before others are sent."""

    def live(self, t_s: float) -> None:
        """Advances the device to that time."""

    def left_operational(self) -> None:
        """Called when the device has left OPERATIONAL: no PDOs are exchanged any longer."""

    def received(self, can_id: int, t_s: float) -> None:
        """Called with every frame that arrived."""

    # --- what it does ---

    @property
    def operational(self) -> bool:
        return bool(self._node.nmt.state == "OPERATIONAL")

    def provoke(self, fault: str) -> None:
        """`unplug`: nothing is sent or received until `plug`; the device goes on living."""
        self._network.muted = fault == "unplug"

    def report(self, code: int) -> None:
        self._network.send_message(cia301.EMERGENCY + self.node_id, cia301.emergency_frame(code))

    def enter_preoperational(self) -> None:
        """Goes to PRE-OPERATIONAL by itself, the default after an error of communication (CiA 301)."""
        if self.operational:
            self._node.nmt.state = "PRE-OPERATIONAL"
            self.left_operational()

    def step(self, wait_s: float = 0.001) -> None:
        """Waits for a frame, handles all that have arrived (at most 200), advances to now, sends a due
        heartbeat. While unplugged, frames are dropped.
        """
        message = self._bus.recv(wait_s)
        left = _MOST_FRAMES
        while message is not None:
            t_s = self._now()
            self.live(t_s)
            if not self._network.muted:
                self.received(message.arbitration_id, t_s)
                self.take(message.arbitration_id, bytes(message.data), t_s)
                self._network.notify(message.arbitration_id, message.data, t_s)
            left -= 1
            message = self._bus.recv(0.0) if left else None
        t_s = self._now()
        self.live(t_s)
        if self._beat_s and t_s >= self._next_beat_s:
            self._next_beat_s = max(self._next_beat_s + self._beat_s, t_s)
            state = cia301.OPERATIONAL if self.operational else _PREOPERATIONAL
            self._network.send_message(cia301.HEARTBEAT + self.node_id, bytes([state]))

    def close(self) -> None:
        self._bus.shutdown()

    def _now(self) -> float:
        return self._clock() - self._start_s

    def _boot(self) -> None:
        self._node.nmt.state = "INITIALISING"
        self._node.nmt.state = "PRE-OPERATIONAL"

    def _on_nmt(self, can_id: int, data: bytearray, stamp: float) -> None:
        """Handles an NMT command to this node or all, after canopen did: boots after a reset. Calls
        `left_operational` when the device is not OPERATIONAL now, even if it was not before.
        """
        del can_id, stamp
        if len(data) != 2 or data[1] not in (0, self.node_id):
            return
        if self._node.nmt.state == "INITIALISING":
            self._boot()
        if not self.operational:
            self.left_operational()

    # --- objects ---

    def _on_write(self, index: int, subindex: int, od: object, data: bytes) -> None:
        """Handles an object that was written: a parameter of a PDO drops the cached table, 1017 sets the
        heartbeat. Calls `written` for every object.
        """
        del od
        if 0x1400 <= index < 0x1C00:
            self._pdos = None
        elif index == cia301.HEARTBEAT_PRODUCER_MS.index:
            self._beat_s = unpacked(cia301.HEARTBEAT_PRODUCER_MS, data) * 1e-3
            self._next_beat_s = self._now() + self._beat_s
        self.written(index, subindex, data)

    def _on_read(self, index: int, subindex: int, od: object) -> float | None:
        del od
        return self.shown(index, subindex)

    def value(self, entry: ObjectEntry) -> float:
        return entry.unpack(self._node.get_data(entry.index, entry.sub))

    # --- PDOs ---

    def _table(self) -> list[tuple[bool, int, int, tuple[tuple[int, int], ...]]]:
        """Returns (sent by the device, identifier, transmission type, mapped objects) of every PDO that is
        on. It is cached until a parameter of a PDO is written.
        """
        if self._pdos is not None:
            return self._pdos
        self._pdos = []
        for transmit in (False, True):
            for number in range(1, 5):
                communication, mapping = cia301.pdo_objects(transmit, number)
                can_id = int(self.value(ObjectEntry(communication, 1, "I")))
                if can_id & _PDO_OFF:
                    continue
                kind = int(self.value(ObjectEntry(communication, 2, "B")))
                self._pdos.append((transmit, can_id & 0x7FF, kind, self._mapped(mapping)))
        return self._pdos

    def _mapped(self, mapping: int) -> tuple[tuple[int, int], ...]:
        """(index and sub-index as in the mapping, bytes) of each mapped object."""
        count = int(self.value(ObjectEntry(mapping, 0, "B")))
        words = [int(self.value(ObjectEntry(mapping, i, "I"))) for i in range(1, count + 1)]
        return tuple((word >> 8, (word & 0xFF) // 8) for word in words)

    def take(self, can_id: int, data: bytes, t_s: float) -> None:
        """Handles SYNC, or an RPDO: one of a synchronous type is kept for the next SYNC, others are applied
        at once. Ignores any other frame, and everything unless OPERATIONAL.
        """
        if not self.operational:
            return
        if can_id == cia301.SYNC:
            self._sync(t_s)
            return
        for transmit, at, kind, mapped in self._table():
            if not transmit and at == can_id:
                if kind <= _MOST_SYNCHRONOUS:
                    self._rpdos[can_id] = data
                else:
                    self._apply(mapped, data)

    def _sync(self, t_s: float) -> None:
        """Applies the RPDOs that wait, calls `synchronised`, and sends the TPDOs due at this SYNC."""
        self._syncs += 1
        for transmit, at, _, mapped in self._table():
            if not transmit and at in self._rpdos:
                self._apply(mapped, self._rpdos.pop(at))
        self.synchronised(t_s)
        for transmit, at, kind, mapped in self._table():
            if transmit and 1 <= kind <= _MOST_SYNCHRONOUS and self._syncs % kind == 0:
                parts = (self._node.get_data(word >> 8, word & 0xFF) for word, _ in mapped)
                self._network.send_message(at, b"".join(parts))

    def _apply(self, mapped: tuple[tuple[int, int], ...], data: bytes) -> None:
        """Writes the data of an RPDO to its mapped objects, each (index << 8 | subindex, bytes), in their
        order; ignores one that is too short.
        """
        if len(data) < sum(size for _, size in mapped):
            return
        start = 0
        for word, size in mapped:
            self._node.set_data(word >> 8, word & 0xFF, bytes(data[start : start + size]))
            start += size


def unpacked(entry: ObjectEntry, data: bytes) -> int:
    return int(struct.unpack_from("<" + entry.kind, data)[0])
