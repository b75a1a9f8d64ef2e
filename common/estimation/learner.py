"""The identification task's side of the predictor: learns from forces, judges predictions, publishes.

It compares a force with the predictions of the `evaluator` for its sample once it has arrived. So late, lost
or reordered forces are learned from once, with the knowledge at the time of their prediction.
"""

import math
from collections.abc import Callable
from concurrent.futures import Future
from heapq import heappop, heappush
from typing import Annotated, Protocol

from forefeel.common.causes.model import ContactModel
from forefeel.common.estimation import band as bands
from forefeel.common.estimation import blend as blends
from forefeel.common.estimation import change_detection, experts
from forefeel.common.estimation import forces as forces_
from forefeel.common.estimation.band import Band
from forefeel.common.estimation.bank import NO_OCTAVE, RING
from forefeel.common.estimation.blend import Blend
from forefeel.common.estimation.change_detection import Change, Trial
from forefeel.common.estimation.contact import Contact, ContactFit, Fitting
from forefeel.common.estimation.contact_columns import Pause
from forefeel.common.estimation.contact_prior import ContactPrior
from forefeel.common.estimation.evaluator import Evaluator, Learned, Reading, Snapshot
from forefeel.common.estimation.experts import Learning
from forefeel.common.estimation.forces import Forces
from forefeel.common.estimation.lost_contact import LostContact
from forefeel.common.kernels.library import kernels
from forefeel.common.kernels.record import Array, Numbers, Record


class Knowledge(Protocol):
    """All that was learned. taken: by ring place, number of the sample whose force has arrived, plus one.

    predicted_n2, zoh_n2: integrals of the squared errors of the prediction and of the zero-order hold.
    octave: of the samples learned from so far.
    """

    octave: float
    predicted_n2: float
    zoh_n2: float
    forces: Forces
    experts: Learning
    blend: Blend
    band: Band
    change: Change
    trial: Trial
    taken: Annotated[Array, RING]


WORSE_THAN_NOTHING = -2

Fit = Callable[[Pause], Contact | None]
Solve = Callable[[Fit], "Future[Contact | None]"]
"""Computes a fit of the contact, at once or beside the loop."""


def at_once(fit: Fit) -> "Future[Contact | None]":
    future: Future[Contact | None] = Future()
    future.set_result(fit(lambda: None))
    return future


class Learner:
    """Learns from forces, and publishes snapshots for an evaluator.

    Args:
        evaluator: its predictions are judged.
        prior: of the contact, from an earlier session, used as given.
        model: of a model.yaml, whose causes take part in the contact.
        solve: computes the fits of the contact. A fit takes effect a quarter of a second of stamps after its
            last sample, or once it is done if that is later.

    Attributes:
        prior: as given; None once it is dropped. fits: number of fits of the contact so far.
        fit_late: True from when a fit was to take effect until it is done.
        renewals: number of times that all was discarded, for bad predictions (`validity`) or a lost contact.
        lost_n: force in N that each lost contact predicted at its loss, see `lost_contact`.
    """

    def __init__(
        self,
        evaluator: Evaluator,
        prior: ContactPrior | None = None,
        model: ContactModel | None = None,
        solve: Solve = at_once,
    ) -> None:
        self._evaluator, self._evaluation = evaluator, evaluator.record
        self._stage, self._contact_n = (evaluator.record.values[name] for name in ("stage", "contact_n"))
        self._kernels, self._reading = kernels(), Numbers(Reading)
        self.prior, self.model, self._solve = prior, model, solve
        self.lost_n: list[float] = []
        self._early: list[tuple[float, float, float]] = []
        self.fits, self.renewals, self.fit_late = 0, -1, False
        self._begin_anew()
        self._taught = self._fit.contact

    def _begin_anew(self) -> None:
        """Discards all that was learned and a fit under way; keeps prior and model. Counts a renewal."""
        self._knowledge = Record(Knowledge)
        values = self._knowledge.values
        values["octave"] = NO_OCTAVE
        self._forces = values["forces"]
        forces_.begin(self._forces)
        experts.begin(values["experts"])
        blends.begin(values["blend"], self.prior is not None or self.model is not None)
        bands.begin(values["band"])
        change_detection.begin(values["trial"])
        self._fit = ContactFit(self.prior, self.model)
        self._fitting: tuple[Fitting, Future[Contact | None]] | None = None
        self._lost_contact = LostContact()
        self.renewals += 1

    def _drop_taught(self) -> None:
        """Goes on without prior and model; what the experts have learned stays."""
        self.prior = self.model = self._fitting = None
        self._fit = ContactFit()
        self._knowledge.values["blend"]["taught"] = 0.0
        self._knowledge.values["trial"] = 0.0
        change_detection.begin(self._knowledge.values["trial"])

    def take(self, stamp_s: float, force_n: float, error_m: float = 0.0) -> None:
        """Learns from a force that was measured at `stamp_s`, the stamp of a motion; in any order, once each.

        A force ahead of the motion waits for it, up to `RING` of them: beyond that one of the later is lost.
        One that is not finite is ignored, one that is far from all before waits until the next confirms it.
        `error_m`: by how much the stage was farther than expected.
        """
        if not (math.isfinite(stamp_s) and math.isfinite(force_n)):
            return
        heappush(self._early, (stamp_s, force_n, error_m))
        moved_s = self._evaluator.moved_s
        while self._early and self._early[0][0] <= moved_s:
            self._take(*heappop(self._early))
        if len(self._early) > RING:
            self._early.pop()

    def _take(self, stamp_s: float, force_n: float, error_m: float) -> None:
        """Learns from one force, and adds it to the fit of the contact if its motion is known. If the
        predictions are found worse than the zero-order hold, drops prior and model, as with them the same
        would be predicted again; without them, discards all that was learned and begins with this force.
        """
        self._reading.pack(stamp_s, force_n)
        n = self._learn()
        if n == WORSE_THAN_NOTHING:
            if self.prior is None and self.model is None:
                self._begin_anew()
            else:
                self._drop_taught()
            n = self._learn()
        if n >= 0:
            self._fit_contact(stamp_s, n % RING, force_n, error_m)

    def _learn(self) -> int:
        """Learns from the reading; number of its sample, -1 if not learned from, or `WORSE_THAN_NOTHING`."""
        n: int = self._kernels.learner_take(
            self._knowledge.address, self._evaluation.address, self._reading.address
        )
        return n

    def _fit_contact(self, stamp_s: float, place: int, force_n: float, error_m: float) -> None:
        """Adds a sample to the fit of the contact, applies a fit that is to take effect by now (sets
        `fit_late` if it is not done), and starts one that is due. If the contact is lost, instead adds to
        `lost_n` and discards prior, model and all that was learned. `place`: of the sample in the ring.
        `error_m` is added to the expected position.
        """
        x_m, v_m_s, a_m_s2 = self._stage[place].tolist()
        x_m += error_m
        free_n = float(self._forces["first_n"])
        foretold_n = float(self._contact_n[place]) - free_n
        contact = self._fit.contact
        if contact and self._lost_contact.judge(stamp_s, x_m, v_m_s, force_n - free_n, foretold_n, contact):
            self.lost_n.append(foretold_n)
            self.prior = self.model = None
            self._begin_anew()
            self._learn()  # else nothing would be known until the next force, and 0 N be predicted
            return
        self._fit.observe(stamp_s, x_m, v_m_s, a_m_s2, force_n, self._evaluator.further[place])
        if self._fitting is not None:
            fitting, result = self._fitting
            due = stamp_s >= fitting.takes_effect_s
            self.fit_late = due and not result.done()
            if due and not self.fit_late:
                contact = result.result()
                self._fit.apply(contact)
                if contact is not None:
                    blend = self._knowledge.values["blend"]
                    blend["unexplained_n"] = contact.left_n
                    if contact.contradicted:
                        blend["taught"] = 0.0
                self.fits += 1
                self._fitting = None
        if self._fitting is None and (begun := self._fit.due()) is not None:
            self._fitting = begun, self._solve(begun.solve)

    def publish(self) -> Snapshot:
        """Snapshot of all that is known now."""
        learned = Record(Learned)
        self._kernels.learner_publish(self._knowledge.address, learned.address)
        learned.values["renewals"] = self.renewals
        band_known = math.isfinite(float(learned.values["factor"]))
        return Snapshot(learned, self._fit.contact, band_known, self._taught)

    @property
    def contact_s(self) -> float:
        """Seconds of contact in this session."""
        contact = self._fit.contact
        before_s = self.prior.contact_s if self.prior is not None else 0.0
        return 0.0 if contact is None else contact.contact_s - before_s

    @property
    def learned(self) -> ContactPrior | None:
        """The contact as a prior for the next session; None before a fit."""
        contact = self._fit.contact
        return contact.prior() if contact is not None and self.fits else None

    @property
    def ratio(self) -> float:
        """rms of the prediction over that of the zero-order hold, of all forces so far; NaN before any."""
        values = self._knowledge.values
        predicted_n2, zoh_n2 = float(values["predicted_n2"]), float(values["zoh_n2"])
        return math.sqrt(predicted_n2 / zoh_n2) if zoh_n2 > 0.0 else math.nan
