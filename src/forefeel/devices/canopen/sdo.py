"""Objects of a CANopen device over SDO, one thread for each device; every failure is one line."""

import struct
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import can
import canopen

from forefeel.common.errors import DeviceError, DeviceSetupError
from forefeel.common.hardware.link import DeviceLink, LinkState
from forefeel.devices.canopen.cia301 import (
    DEVICE_TYPE,
    ENTER_PREOPERATIONAL,
    NMT,
    PRODUCT,
    REVISION,
    SERIAL,
    VENDOR,
    ObjectEntry,
    profile,
)
from forefeel.devices.canopen.network import SharedNetwork, acquire, release
from forefeel.devices.shared.settings import CanSettings

_TRIES = 3  # attempts at an object before the device counts as silent


@contextmanager
def talking_to(
    settings: CanSettings, node: int, link: DeviceLink
) -> Iterator[tuple[SharedNetwork, "RemoteDevice"]]:
    """Yields (network, device) on the bus for the length of a block; the link is OPEN. At the end the device
    is forgotten, the bus counters are added to the link, and the bus is released.
    """
    shared = acquire(settings)
    try:
        link.advance(LinkState.OPEN)
        device = RemoteDevice(shared, node, link)
        try:
            yield shared, device
        finally:
            device.forget()
            shared.update_counters(link)
    finally:
        release(shared)


def can_link(slot: str, driver: str, settings: CanSettings, node: int) -> DeviceLink:
    return DeviceLink(f"{slot} {driver} node {node} on {settings.interface} {settings.channel}")


class RemoteDevice:
    """The node of a device on a shared network, from here to `forget`."""

    def __init__(self, shared: SharedNetwork, node: int, link: DeviceLink) -> None:
        self.name = f"node {node} on {shared.name}"
        self.node = node
        self._shared, self._link = shared, link
        if node in shared.network.nodes:
            raise DeviceSetupError(f"{self.name}: expected one driver for each node, it has another already")
        self._remote = canopen.RemoteNode(node, canopen.ObjectDictionary())
        shared.network.add_node(self._remote)

    def forget(self) -> None:
        del self._shared.network[self.node]

    def identify(self, expected: int) -> None:
        """Puts the device in PRE-OPERATIONAL, reads identity and serial number into the link: IDENTIFIED. A
        number that the device refuses is 0. DeviceSetupError: no answer, or a profile other than `expected`.
        """
        self.order(ENTER_PREOPERATIONAL)
        try:
            kind = int(self.read(DEVICE_TYPE))
        except _SilentError as error:
            raise DeviceSetupError(
                f"{self.name}: no answer; expected a CiA {expected} device: check node_id, bitrate and wiring"
            ) from error
        if profile(kind) != expected:
            raise DeviceSetupError(f"{self.name}: a CiA {profile(kind)} device, expected CiA {expected}")
        entries = {"vendor": VENDOR, "product": PRODUCT, "revision": REVISION, "serial": SERIAL}
        identity = {name: f"{int(self.read(entry, 0)):08X}" for name, entry in entries.items()}
        self._link.identity = ", ".join(f"{name} {value}" for name, value in identity.items())
        self._link.serial = identity["serial"]
        self._link.advance(LinkState.IDENTIFIED)

    def order(self, command: int) -> None:
        self._shared.send(NMT, bytes([command, self.node]))

    def read(self, entry: ObjectEntry, otherwise: float | None = None) -> float:
        """Reads the value of an entry; returns `otherwise`, where it is given, when the device refuses.
        DeviceError: no answer, refused, or too few bytes.
        """
        try:
            return entry.unpack(self._try("reading", entry, None))
        except ValueError as error:
            raise DeviceError(f"{self.name}: {error}") from error
        except _RefusedError:
            if otherwise is None:
                raise
            return otherwise

    def write(self, entry: ObjectEntry, value: float) -> None:
        """Writes an entry, and reads it back. DeviceError: no answer, or refused. DeviceSetupError: the value
        does not fit into the entry, or the device took another one.
        """
        self._download(entry, value)
        actual = self.read(entry)
        if actual != value:
            raise DeviceSetupError(f"{self.name}: {entry} = {actual:g} after {value:g} was written")

    def write_all(self, values: Iterable[tuple[ObjectEntry, float]]) -> None:
        for entry, value in values:
            self.write(entry, value)

    def offer(self, entry: ObjectEntry, value: float) -> bool:
        """Writes an entry that a device need not have, without reading it back; false when it refuses. Raises
        as `write`.
        """
        try:
            self._download(entry, value)
        except _RefusedError:
            return False
        return True

    def _download(self, entry: ObjectEntry, value: float) -> None:
        try:
            data = entry.pack(value)
        except struct.error as error:
            raise DeviceSetupError(f"{self.name}: {entry} = {value}: does not fit into it") from error
        self._try("writing", entry, data)

    def _try(self, what: str, entry: ObjectEntry, data: bytes | None) -> bytes:
        """Returns the bytes of an entry; with `data` writes that to it instead, and returns b"". Three
        attempts. `what`: the verb for errors. `_SilentError`: no answer to any; `_RefusedError`: the device
        refuses, at once; DeviceError: the bus failed.
        """
        for left in reversed(range(_TRIES)):
            self._shared.check()
            self._shared.update_counters(self._link)  # a handshake over a bad wire takes its time, too
            try:
                if data is None:
                    return bytes(self._remote.sdo.upload(entry.index, entry.sub))
                self._remote.sdo.download(entry.index, entry.sub, data)
            except canopen.SdoAbortedError as error:
                raise _RefusedError(
                    f"{self.name}: {what} {entry} is refused ({error}); expected a device that has it: "
                    "check node_id and driver"
                ) from error
            except (canopen.SdoCommunicationError, struct.error) as error:  # the latter: one cut short
                if not left:
                    raise _SilentError(f"{self.name}: no answer to {what} {entry}") from error
            except (can.CanError, OSError, RuntimeError) as error:
                raise DeviceError(f"{self.name}: {what} {entry} failed ({error})") from error
            else:
                return b""
        raise AssertionError("unreachable")


class _SilentError(DeviceError):
    """No answer over SDO."""


class _RefusedError(DeviceSetupError):
    """An abort: an object that the device has not, or not so."""
