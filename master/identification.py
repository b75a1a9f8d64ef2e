"""The identification task: learns from the forces that arrive late, and publishes what it knows."""

from forefeel.common.causes.model import ContactModel
from forefeel.common.estimation.contact import Contact
from forefeel.common.estimation.contact_prior import ContactPrior
from forefeel.common.estimation.learner import Learner, Solve, at_once
from forefeel.common.messages import ForceSample, Grip
from forefeel.common.slots import BoundedQueue
from forefeel.master.prediction import ForcePrediction

_QUEUE = 8192  # eight seconds at 1 kHz


class IdentificationTask:
    """Runs on asyncio beside the haptic loop; the loop pulls `snapshot`, one reference, without a lock.

    A force and the readback of the same instant travel in one sample with the stamp of the command that
    they answer: the network can delay, lose or reorder such samples, and mixes nothing.

    Args:
        prediction: in the loop, whose predictions are judged.
        prior: of the contact, from an earlier session.
        model: of a model.yaml, whose causes take part in the contact.
        solve: see `forefeel.common.estimation.learner`.

    Attributes:
        queue: filled by the transport's thread. snapshot: what is known. used, unused: samples so far.
    """

    def __init__(
        self,
        prediction: ForcePrediction,
        prior: ContactPrior | None = None,
        model: ContactModel | None = None,
        solve: Solve = at_once,
    ) -> None:
        self.queue: BoundedQueue[ForceSample] = BoundedQueue(_QUEUE)
        self._prediction = prediction
        self._before_s = prior.contact_s if prior is not None else 0.0
        self._learner = Learner(prediction.evaluator, prior, model, solve)
        self.snapshot = self._learner.publish()
        self.used = self.unused = 0

    def run(self) -> None:
        """Learns from what has arrived since the last call, in the order of the stamps, and publishes it."""
        samples = [sample for sample in self.queue.drain() if self._usable(sample)]
        for sample in sorted(samples, key=lambda sample: sample.answers_stamp_ns or 0):
            self._prediction.stage.observe(sample.answers_stamp_ns or 0, sample.position_m)
            if (stamp_s := self._prediction.stamp_s(sample)) is not None:
                self._learner.take(stamp_s, sample.force_n)
        self.snapshot = self._learner.publish()

    def _usable(self, sample: ForceSample) -> bool:
        """Whether it answers a command, with the instrument held."""
        usable = sample.valid and sample.gripper is Grip.CLOSED and sample.answers_stamp_ns is not None
        self.used += usable
        self.unused += not usable
        return usable

    @property
    def contact(self) -> Contact | None:
        return self.snapshot.contact

    @property
    def contact_s(self) -> float:
        """Seconds of contact in this session."""
        return 0.0 if self.contact is None else self.contact.contact_s - self._before_s

    @property
    def learned(self) -> ContactPrior | None:
        """What this session has to tell the next one."""
        contact = self.snapshot.contact
        return contact.prior() if contact is not None and self.fits else None

    @property
    def fits(self) -> int:
        return self._learner.fits

    @property
    def renewals(self) -> int:
        return self._learner.renewals

    @property
    def ratio(self) -> float:
        """rms of the prediction over that of the zero-order hold so far; NaN before any force."""
        return self._learner.ratio
