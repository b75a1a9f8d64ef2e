"""The state of a link to a device. Pure.

```
CLOSED -> OPEN -> IDENTIFIED -> CONFIGURED -> READY
any --fault--> CLOSED, inhibited: the handshake may be repeated up to CONFIGURED, READY needs `rearm`
```
"""

from collections import Counter
from enum import IntEnum
from threading import Lock

from forefeel.common.errors import DeviceError
from forefeel.common.slots import BoundedQueue

_KEPT_ROUND_TRIPS = 8192  # round trips that wait to be taken: 8.2 s at 1 kHz


class LinkState(IntEnum):
    """Steps of a link; only READY may move or measure."""

    CLOSED = 0
    OPEN = 1
    IDENTIFIED = 2
    CONFIGURED = 3
    READY = 4


class DeviceLink:
    """State of one device's link: takes the steps of the handshake in turn, counts every fault.

    Attributes:
        name: of the device, for texts: `stage zaber_ascii on /dev/ttyUSB0`.
        identity: what the device said it is.
        serial: its serial number, as it said it; calibrations are bound to it. Empty: it has none.
        exchanges: readings, readbacks or replies that have come so far; see `exchanged`.
        round_trips_ns: of the exchanges whose question and answer the driver saw, the newest.
        counters: faults and whatever the driver counts (`bad_checksum`, `resynchronised`).
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.identity = ""
        self.serial = ""
        self.exchanges = 0
        self.round_trips_ns: BoundedQueue[int] = BoundedQueue(_KEPT_ROUND_TRIPS)
        self.counters: Counter[str] = Counter()
        self._state = LinkState.CLOSED
        self._inhibited: str | None = None
        self._lock = Lock()

    @property
    def state(self) -> LinkState:
        return self._state

    @property
    def inhibited(self) -> str | None:
        """The fault that nobody has re-armed after; None when there is none."""
        return self._inhibited

    def advance(self, to: LinkState) -> None:
        """Sets the state to `to`, the next step of the handshake; READY has no effect while inhibited.

        Raises:
            ValueError: `to` is not the next step.
        """
        with self._lock:
            if to != self._state + 1:
                raise ValueError(f"{self.name}: {to.name} after {self._state.name}")
            if to is LinkState.READY and self._inhibited is not None:
                return
            self._state = to

    def exchanged(self, round_trip_ns: int | None = None) -> None:
        """Counts a reading, readback or reply that has come; called by the conversation's thread alone."""
        self.exchanges += 1
        if round_trip_ns is not None:
            self.round_trips_ns.put(round_trip_ns)

    def fault(self, reason: str) -> None:
        """Closes and inhibits the link, from any thread; the first reason since a re-arming is kept."""
        with self._lock:
            self.counters["faults"] += 1
            self._inhibited = self._inhibited or reason
            self._state = LinkState.CLOSED

    def begin(self) -> None:
        """Closes the link and lifts any inhibition, for opening a device is an explicit act."""
        with self._lock:
            self._inhibited, self._state = None, LinkState.CLOSED

    def close(self) -> None:
        with self._lock:
            self._state = LinkState.CLOSED

    def rearm(self) -> None:
        """Lifts the inhibition after a fault and makes a CONFIGURED link READY; does nothing without a fault.

        Raises:
            DeviceError: the handshake has not been repeated yet; the inhibition stays.
        """
        with self._lock:
            if self._inhibited is None:
                return
            if self._state is not LinkState.CONFIGURED:
                raise DeviceError(f"{self.name}: {self._inhibited}; the link is {self._state.name.lower()}")
            self._inhibited = None
            self._state = LinkState.READY

    def require_ready(self) -> None:
        """Raises DeviceError, with the reason, unless READY."""
        if self._state is not LinkState.READY:
            why = self._inhibited or f"link {self._state.name.lower()}, expected it ready"
            raise DeviceError(f"{self.name}: {why}")
