"""The identification task: late forces in batches, paired with the motion that caused them by the slave's own
stamps.
"""

from common.estimation.identification import ContactEstimate, ContactIdentifier
from common.messages import ForceSample
from common.slots import BoundedQueue

_QUEUE = 8192  # eight seconds at 1 kHz


class IdentificationTask:
    """Runs on asyncio beside the haptic loop; the loop reads `estimate`, one reference, without a lock.

    A force and the readback of the same instant travel in one sample, so that the pair is formed where both
    were measured: the
    network can delay, lose or reorder pairs, never mix them.

    Attributes:
        estimate: newest estimate; queue: filled by the transport's thread.
    """

    def __init__(self, identifier: ContactIdentifier) -> None:
        self.queue: BoundedQueue[ForceSample] = BoundedQueue(_QUEUE)
        self.estimate: ContactEstimate | None = None
        self._identifier = identifier
        self.unused = 0

    def run(self) -> None:
        """Learns from what has arrived since the last call."""
        batch = sorted(self.queue.drain(), key=lambda sample: sample.stamp_ns)
        for sample in batch:
            if sample.valid and sample.answers_sequence is not None:
                self._identifier.observe(sample.stamp_ns, sample.position_m, sample.force_n)
            else:
                self.unused += 1

    def update_estimate(self) -> None:
        """Makes what was learned visible to the loop; a tenth of a millisecond, so less often than `run`."""
        self.estimate = self._identifier.estimate()

    def identifiable(self) -> tuple[str, ...]:
        """What the motion so far lets one tell apart, in plain words."""
        return self._identifier.identifiable()
