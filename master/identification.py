"""The identification task: late forces in batches, paired with the motion that caused them by the slave's own
stamps.
"""

from itertools import groupby
from typing import Protocol

from forefeel.common.estimation.identification import ContactEstimate, ContactIdentifier
from forefeel.common.messages import ForceSample, Grip
from forefeel.common.slots import BoundedQueue

_QUEUE = 8192  # eight seconds at 1 kHz
# ns, least time between two forces that are identified from: 250 Hz, 16 times the default cutoff of 15 Hz
_EVERY_NS = 4_000_000
_PAUSE_NS = 1_000_000_000  # long enough for the identifier to start its filters anew


class Learning(Protocol):
    """What else learns from each force; see `forefeel.master.prediction`."""

    def learn(self, sample: ForceSample) -> float:
        """Takes a sample in; what of its force in N the motion may explain."""
        ...

    def publish(self) -> None:
        """Gives the haptic loop what was learned."""
        ...


class IdentificationTask:
    """Runs on asyncio beside the haptic loop; the loop reads `estimate`, one reference, without a lock.

    A force and the readback of the same instant travel in one sample, so that the pair is formed where both
    were measured: the
    network can delay, lose or reorder pairs, never mix them.

    The contact model's parameters are identified from 250 samples a second: its filters pass less than that.

    Args:
        identifier: of the contact model's parameters.
        prediction: learns from each sample, too.

    Attributes:
        estimate: newest estimate; queue: filled by the transport's thread.
    """

    def __init__(self, identifier: ContactIdentifier, prediction: Learning) -> None:
        self.queue: BoundedQueue[ForceSample] = BoundedQueue(_QUEUE)
        self.estimate: ContactEstimate | None = None
        self._identifier = identifier
        self._prediction = prediction
        self.unused = 0
        self._session_id = 0
        self._shift_ns = 0
        self._last_ns: int | None = None
        self._identified_ns: int | None = None

    def run(self) -> None:
        """Learns from what has arrived since the last call."""
        for _, batch in groupby(self.queue.drain(), key=lambda sample: sample.session_id):
            for sample in sorted(batch, key=lambda sample: sample.stamp_ns):
                held = sample.gripper is Grip.CLOSED
                if held and sample.valid and sample.answers_sequence is not None:
                    force_n = self._prediction.learn(sample)
                    self._identify(self._stamp_ns(sample), sample.position_m, force_n)
                else:
                    self.unused += 1
        self._prediction.publish()

    def _identify(self, stamp_ns: int, position_m: float, force_n: float) -> None:
        if self._identified_ns is None or stamp_ns - self._identified_ns >= _EVERY_NS:
            self._identified_ns = stamp_ns
            self._identifier.observe(stamp_ns, position_m, force_n)

    def _stamp_ns(self, sample: ForceSample) -> int:
        """The sample's stamp; where a new session begins behind the old one (the slave's host was started
        again), moved on to follow it.
        """
        new_session, self._session_id = sample.session_id != self._session_id, sample.session_id
        last_ns = self._last_ns
        if new_session and last_ns is not None and sample.stamp_ns + self._shift_ns <= last_ns:
            self._shift_ns = last_ns + _PAUSE_NS - sample.stamp_ns
        stamp_ns = sample.stamp_ns + self._shift_ns
        self._last_ns = stamp_ns if last_ns is None else max(last_ns, stamp_ns)
        return stamp_ns

    def update_estimate(self) -> None:
        """Makes what was learned visible to the loop; a tenth of a millisecond, so less often than `run`."""
        self.estimate = self._identifier.estimate()

    def identifiable(self) -> tuple[str, ...]:
        """What the motion so far lets one tell apart, in plain words."""
        return self._identifier.identifiable()
