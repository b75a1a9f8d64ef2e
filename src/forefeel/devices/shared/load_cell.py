"""Load cells with a thread of their own: the port, and the queue from the thread to the loop."""

from collections.abc import Sequence

from forefeel.common.errors import DeviceError
from forefeel.common.hardware.calibration import LoadCellCalibration
from forefeel.common.hardware.link import DeviceLink, LinkState
from forefeel.common.slots import BoundedQueue
from forefeel.devices.shared.conversation import Conversation, Steps
from forefeel.devices.shared.force_scale import ForceScale, Native
from forefeel.slave.load_cell import LoadCellReading, NativeReading

_QUEUED_READINGS = 4096  # readings that wait for the control loop: 5 s at 800 Hz


class QueuedLoadCell:
    """Load-cell port; the subclasses define the conversation.

    Attributes:
        link: its state, identity and counters.
        stale_s: a newest reading that is older than this is not to be believed.
        calibration: as it was loaded; None: there is none.
    """

    def __init__(self, link: DeviceLink, full_scale_n: float, stale_s: float) -> None:
        self.link, self.full_scale_n, self.stale_s = link, full_scale_n, stale_s
        self.calibration: LoadCellCalibration | None = None
        self._force: ForceScale | None = None
        self._native = False
        self._queue = BoundedQueue[Native](_QUEUED_READINGS)
        self._conversation: Conversation | None = None

    def open(self) -> None:
        """Starts the conversation, unless it runs, and waits until the link is READY; raises as `start`. What
        had been read before is dropped.
        """
        if self._conversation is None:
            self._queue.drain()
            conversation = Conversation(self.link, self._converse)
            conversation.start(self._open_s())
            self._conversation = conversation

    def open_native(self) -> None:
        """Opens the cell for `read_native` alone (`NativeLoadCell`); the calibration is not looked at."""
        self._native = True
        self.open()

    def close(self) -> None:
        if self._conversation is not None:
            self._conversation.stop()
            self._conversation = None

    def rearm(self) -> None:
        """Permits readings again, and discards those before, which may have waited for as long as the stage
        had a fault. DeviceError: the cell has not come back yet.
        """
        self.link.counters["discarded"] += len(self._queue.drain())
        self.link.rearm()

    def read(self, now_ns: int, recording_time_s: float | None) -> Sequence[LoadCellReading]:
        """The readings since the last call, each with the host's stamp of its measurement; never waits."""
        del now_ns, recording_time_s
        self.link.require_ready()
        if self._native or self._force is None:
            raise DeviceError(f"{self.link.name}: opened for its native readings")
        return [self._force.reading(native) for native in self._queue.drain()]

    def read_native(self, now_ns: int) -> Sequence[NativeReading]:
        """The readings since the last call of a cell that `open_native` opened."""
        del now_ns
        self.link.require_ready()
        return [NativeReading(m.value, not m.flaws, m.stamp_ns) for m in self._queue.drain()]

    def _open_s(self) -> float:
        """Time in s that opening may take."""
        raise NotImplementedError

    def _converse(self, conversation: Conversation) -> Steps:
        raise NotImplementedError

    def _measured(self, native: Native) -> None:
        """Checks a measurement and queues it for the control loop; unless READY it is dropped and counted.
        Counts the exchange of the link, and sets its counter `unread` to what a full queue has lost.
        """
        assert self._force is not None
        self.link.exchanged()
        checked = self._force.checked(native)
        if self.link.state is LinkState.READY:
            self._queue.put(checked)
        else:
            self.link.counters["while_inhibited"] += 1
        self.link.counters["unread"] = self._queue.dropped
