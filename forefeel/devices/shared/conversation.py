"""A thread that talks to one device: handshake, then exchange; after a fault all of it again.

The thread hands over through one bounded queue (`forefeel.common.slots.BoundedQueue`) or one slot; every
value carries the host's stamp and, where the device has a clock, the device's.
"""

import threading
from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

from forefeel.common.errors import DeviceError, InputError
from forefeel.common.hardware.link import DeviceLink, LinkState
from forefeel.common.runtime.realtime import go_before

T = TypeVar("T")
RETRY_S = 0.5  # s from a fault to the next handshake; chosen, not measured: longer comes back later
_STEPS = 10
"""Short and paced, so ahead of what computes in this process and in others, and behind the 1 kHz loop."""


class Timed(NamedTuple, Generic[T]):
    """A value, when the host had it, and when the device made it (s of its own clock; None: it has none)."""

    host_ns: int
    device_s: float | None
    value: T


class Conversation:
    """Runs `converse` in a thread of its own until `stop`.

    `converse` opens the device, advances the link to READY (CONFIGURED after a fault: `DeviceLink.advance`
    knows), and exchanges until `stopping`; whatever it raises is a fault of the link, and it is called again
    after a pause. It closes what it opened.
    """

    def __init__(
        self, link: DeviceLink, converse: Callable[["Conversation"], None], retry_s: float = RETRY_S
    ) -> None:
        self.link = link
        self._converse, self._retry_s = converse, retry_s
        self._stopping, self._settled = threading.Event(), threading.Event()
        self._first: BaseException | None = None
        self._thread: threading.Thread | None = None

    @property
    def stopping(self) -> bool:
        """Whether `converse` has been asked to return."""
        return self._stopping.is_set()

    def pause(self, seconds: float) -> None:
        """Waits, but not longer than until `stop`."""
        self._stopping.wait(seconds)

    def start(self, timeout_s: float) -> None:
        """Starts, and waits until the device is ready.

        Raises:
            DeviceError: the first handshake failed, with its reason, or takes too long; the thread has ended.
            InputError: what the settings name (a calibration) does not fit the device.
        """
        self.link.begin()
        self._thread = threading.Thread(target=self._run, name=self.link.name, daemon=True)
        self._thread.start()
        self._settled.wait(timeout_s)
        if self.link.state is LinkState.READY:
            return
        first = self._first
        self.stop()
        if isinstance(first, DeviceError | InputError):
            raise first
        raise DeviceError(f"{self.link.name}: {first or f'not ready within {timeout_s:g} s'}") from first

    def settled(self) -> None:
        """To be called by `converse` when the handshake is done, after its last `advance`."""
        self._settled.set()

    def stop(self) -> None:
        """Asks `converse` to return and waits for it; idempotent, from any other thread."""
        self._stopping.set()
        thread = self._thread
        # a signal may have come between making the thread and starting it
        if thread is not None and thread.is_alive() and thread is not threading.current_thread():
            thread.join(5.0)
        self.link.close()

    def _run(self) -> None:
        go_before(_STEPS)
        while not self.stopping:
            try:
                self._converse(self)
            except Exception as error:  # noqa: BLE001 - the thread's last line: every fault inhibits the link
                if not self._settled.is_set():
                    self._first = error
                    self._stopping.set()
                self.link.fault(
                    str(error) if isinstance(error, DeviceError) else f"{type(error).__name__}: {error}"
                )
            finally:
                self._settled.set()
            self.pause(self._retry_s)
