"""A thread that talks to one device in steps: handshake, then exchange; after a fault all of it again.

The thread hands over through one bounded queue (`forefeel.common.slots.BoundedQueue`) or one slot; every
value carries the host's stamp.
"""

import threading
import time
from collections.abc import Callable, Iterator

from forefeel.common.clock import Clock
from forefeel.common.errors import DeviceError, InputError
from forefeel.common.hardware.link import DeviceLink, LinkState
from forefeel.common.runtime.realtime import go_before

Steps = Iterator[float]  # the steps of an exchange; each value: s until the next one
RETRY_S = 0.5  # s from a fault to the next handshake
_CYCLE_S = 0.1  # s, longest wait that is a cycle: it is kept while the exchange is brought to its end
_STEPS = 10  # priority: ahead of what computes, for steps are short and paced; behind the 1 kHz loop


class Conversation:
    """Steps `converse` in a thread of its own until `stop`.

    `converse` opens the device, advances the link to READY (CONFIGURED after a fault: `DeviceLink.advance`
    knows), exchanges, ends when it is `stopping`, and closes what it opened. Whatever it raises is a fault of
    the link, and it is begun again after `RETRY_S`.
    """

    def __init__(self, link: DeviceLink, converse: Callable[["Conversation"], Steps]) -> None:
        self.link = link
        self.stopping = False
        self._converse = converse
        self._steps: Steps | None = None
        self._first: BaseException | None = None
        self._stop, self._settled = threading.Event(), threading.Event()
        self._thread: threading.Thread | None = None

    def start(self, timeout_s: float) -> None:
        """Lifts any inhibition of the link, starts the thread, and waits until the link is READY.

        Raises:
            DeviceError: the first handshake failed, with its reason, or takes too long; the thread has ended.
            InputError: what the settings name (a calibration) does not fit the device.
        """
        self.link.begin()
        self._begin(timeout_s)
        if self.link.state is LinkState.READY:
            return
        first = self._first
        self.stop()
        if isinstance(first, DeviceError | InputError):
            raise first
        raise DeviceError(f"{self.link.name}: {first or f'not ready within {timeout_s:g} s'}") from first

    def stop(self) -> None:
        """Ends the exchange in order, waits 5 s at most for its thread, closes the link; idempotent."""
        self.stopping = True
        self._stop.set()
        self._end()
        self.link.close()

    def step(self) -> float | None:
        """Runs `converse` to its next yield; returns the s to wait before the next step, None at the end. An
        exception becomes a fault of the link, and `converse` begins anew 0.5 s later; before the first READY
        it ends the conversation instead (`stopping` is set).
        """
        if self._steps is None and self.stopping:
            return None
        wait_s: float | None = None
        try:
            self._steps = self._steps or self._converse(self)
            wait_s = next(self._steps, None)
        except Exception as error:  # noqa: BLE001 - every fault inhibits the link
            if not self._settled.is_set():
                self._first, self.stopping = error, True
                self._settled.set()
            self.link.fault(
                str(error) if isinstance(error, DeviceError) else f"{type(error).__name__}: {error}"
            )
        if self.link.state is LinkState.READY:
            self._settled.set()
        if wait_s is None:
            self._steps = None
            return None if self.stopping else RETRY_S
        return wait_s

    @property
    def settled(self) -> bool:
        """The first handshake is done, or failed."""
        return self._settled.is_set()

    def _begin(self, timeout_s: float) -> None:
        self._thread = threading.Thread(target=self._run, name=self.link.name, daemon=True)
        self._thread.start()
        self._settled.wait(timeout_s)

    def _end(self) -> None:
        thread = self._thread
        # a signal may have come between making the thread and starting it
        if thread is not None and thread.is_alive() and thread is not threading.current_thread():
            thread.join(5.0)

    def _run(self) -> None:
        """Raises the thread's priority, then calls `step` until it returns None, waiting for the time that it
        returns. A wait of more than 0.1 s ends at once with `stop`.
        """
        go_before(_STEPS)
        while (wait_s := self.step()) is not None:
            if wait_s > _CYCLE_S:
                self._stop.wait(wait_s)
            elif wait_s > 0.0:
                time.sleep(wait_s)


class Pacer:
    """Deadlines at a fixed period; one that has been missed is left out, so that cycles never bunch.

    Attributes:
        missed: deadlines that were left out.
    """

    def __init__(self, clock: Clock, period_ns: int) -> None:
        self._clock, self._period_ns = clock, period_ns
        self._deadline_ns = clock.now_ns()
        self.missed = 0

    def wait_s(self) -> float:
        """Moves the deadline on by a period; returns s until then. If it has passed, adds the missed ones to
        `missed` and sets it a period from now.
        """
        now_ns = self._clock.now_ns()
        self._deadline_ns += self._period_ns
        late_ns = now_ns - self._deadline_ns
        if late_ns > 0:
            self.missed += 1 + late_ns // self._period_ns
            self._deadline_ns = now_ns + self._period_ns
        return (self._deadline_ns - now_ns) * 1e-9
