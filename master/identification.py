"""The identification task: learns from the forces that arrive late, and publishes what it knows."""

from operator import itemgetter

from forefeel.common.estimation.learner import Learner
from forefeel.common.messages import ForceSample
from forefeel.common.slots import BoundedQueue
from forefeel.master.prediction import ForcePrediction

_QUEUE = 8192  # eight seconds at 1 kHz


class IdentificationTask:
    """Runs on asyncio beside the haptic loop; the loop pulls `snapshot`, one reference, without a lock.

    A force and the readback of the same instant travel in one sample with the stamp of the command that
    they answer: the network can delay, lose or reorder such samples, and mixes nothing.

    Args:
        prediction: in the loop.
        learner: learns what the prediction's evaluator is to know.

    Attributes:
        queue: filled by the transport's thread. snapshot: what is known. used, unused: samples so far.
    """

    def __init__(self, prediction: ForcePrediction, learner: Learner) -> None:
        self.queue: BoundedQueue[ForceSample] = BoundedQueue(_QUEUE)
        self._prediction = prediction
        self.learner = learner
        self.snapshot = learner.publish()
        self.used = self.unused = 0

    def run(self) -> None:
        """Learns from what has arrived since the last call, in the order of the stamps, and publishes it."""
        samples = self.queue.drain()
        known = [(s, sample) for sample in samples if (s := self._prediction.stamp_s(sample)) is not None]
        self.used += len(known)
        self.unused += len(samples) - len(known)
        for stamp_s, sample in sorted(known, key=itemgetter(0)):
            self._prediction.lag.observe(sample.answers_stamp_ns or 0, sample.position_m)
            self.learner.take(stamp_s, sample.force_n)
        self.snapshot = self.learner.publish()
