"""The identification task's side of the predictor: learns from the forces that arrive, judges, weighs,
publishes.

It reads what the `evaluator` has said of a sample when the force of that sample has come; so only errors
that were seen count, and late, lost or reordered forces are learned from once, with what was known when
they were foretold.
"""

import math
from heapq import heappop, heappush
from typing import Annotated, Protocol

import numpy as np
from numpy.typing import NDArray

from forefeel.common.estimation import band as bands
from forefeel.common.estimation import bank as banks
from forefeel.common.estimation import blend as blends
from forefeel.common.estimation import change as changes
from forefeel.common.estimation import experts
from forefeel.common.estimation import forces as beliefs
from forefeel.common.estimation import trial as trials
from forefeel.common.estimation.band import Band
from forefeel.common.estimation.bank import RING
from forefeel.common.estimation.blend import ZOH, Blend
from forefeel.common.estimation.change import Change
from forefeel.common.estimation.evaluator import Evaluation, Evaluations, Evaluator
from forefeel.common.estimation.experts import Learning
from forefeel.common.estimation.forces import Forces
from forefeel.common.estimation.snapshot import new_snapshot
from forefeel.common.estimation.trial import Trial
from forefeel.common.jit import Array, kernel, record, zeros

_PLAIN = blends.FIRST + experts.PLAIN


class Knowledge(Protocol):
    """All that was learned. taken: number of the sample whose force was taken in, plus one, by its place."""

    forces: Forces
    experts: Learning
    blend: Blend
    band: Band
    change: Change
    trial: Trial
    taken: Annotated[Array, RING]


_DTYPE = record(Knowledge)


def _new_knowledge() -> NDArray[np.void]:
    knowledge = zeros(_DTYPE)
    beliefs.begin(knowledge["forces"])
    experts.begin(knowledge["experts"])
    blends.begin(knowledge["blend"])
    bands.begin(knowledge["band"])
    trials.begin(knowledge["trial"])
    return knowledge


class Learner:
    """Learns what an evaluator is to know.

    Attributes:
        renewals: how often it began anew, for what it had learned was worse than nothing, see `trial`.
    """

    def __init__(self, evaluator: Evaluator) -> None:
        self._evaluation = evaluator.record
        self._knowledge = _new_knowledge()
        self._early: list[tuple[float, float]] = []
        self.renewals = 0

    def take(self, stamp_s: float, force_n: float) -> None:
        """A force that was measured at `stamp_s`, the stamp of a motion; in any order, each counts once.

        One that is ahead of the motion waits for it. One that is not finite, or far from all that were seen
        before, is left out, the latter until the next one confirms it.
        """
        if not (math.isfinite(stamp_s) and math.isfinite(force_n)):
            return
        heappush(self._early, (stamp_s, force_n))
        moved_s = _moved_s(self._evaluation)
        while self._early and self._early[0][0] <= moved_s:
            self._take(*heappop(self._early))
        if len(self._early) > RING:
            self._early.pop()

    def _take(self, stamp_s: float, force_n: float) -> None:
        if not _take(self._knowledge, self._evaluation, stamp_s, force_n):
            self._knowledge = _new_knowledge()
            self.renewals += 1
            _take(self._knowledge, self._evaluation, stamp_s, force_n)

    def publish(self) -> NDArray[np.void]:
        """A snapshot of all that is known now."""
        snapshot = new_snapshot()
        _publish(self._knowledge, snapshot)
        snapshot["renewals"] = self.renewals
        return snapshot


@kernel
def _moved_s(evaluations: Evaluations) -> float:
    """Stamp of the newest motion."""
    bank = evaluations[0].bank
    return float(bank.t_s[(int(bank.count) - 1) % RING])


@kernel
def _take(knowledges: NDArray[np.void], evaluations: Evaluations, stamp: float, force_n: float) -> bool:
    """A force that has arrived; False when the learner is to begin anew."""
    knowledge, evaluation = knowledges[0], evaluations[0]
    n = banks.find(evaluation.bank, stamp)
    if n >= 0:
        if knowledge.taken[n % RING] == n + 1.0:
            return True
        knowledge.taken[n % RING] = n + 1.0
    forces = knowledge.forces
    for k in range(beliefs.admit(forces, stamp, force_n)):
        n = banks.find(evaluation.bank, forces.admitted[k, 0])
        if n >= 0 and forces.known >= beliefs.FIRST and not math.isnan(evaluation.force_n[n % RING]):
            _learn(knowledge, evaluation, n, forces.admitted[k, 1])
    good: bool = knowledge.trial.failed == 0.0
    return good


@kernel
def _learn(knowledge: Knowledge, evaluation: Evaluation, n: int, force_n: float) -> None:
    """The force of sample n beside what was said of it."""
    bank, forces, i = evaluation.bank, knowledge.forces, n % RING
    said_n, range_n = evaluation.said_n[i], forces.high_n - forces.low_n
    h = min(max(bank.period_s, 1e-4), 0.05)
    experts.renew_stops(knowledge.experts, bank.radii_m)
    if not banks.at_rest(bank, n):
        experts.learn(
            knowledge.experts,
            evaluation.rows[i],
            bank.t_s[i],
            force_n - said_n[ZOH],
            force_n - forces.first_n,
            h,
        )
        trials.judge(knowledge.trial, force_n, evaluation.force_n[i], said_n[ZOH], h)
    blends.judge(knowledge.blend, said_n, force_n, range_n, h)
    bands.learn(
        knowledge.band, force_n - evaluation.force_n[i], evaluation.half_n[i], evaluation.scale_n[i], h
    )
    if changes.noticed(knowledge.change, said_n[_PLAIN] - force_n, range_n, h):
        experts.discount(knowledge.experts)
        blends.discount(knowledge.blend)
    if not (math.isfinite(knowledge.blend.weights[ZOH]) and math.isfinite(knowledge.experts.theta.sum())):
        knowledge.trial.failed = 1.0


@kernel
def _publish(knowledges: NDArray[np.void], snapshots: NDArray[np.void]) -> None:
    knowledge, snapshot = knowledges[0], snapshots[0]
    forces, blend, band = knowledge.forces, knowledge.blend, knowledge.band
    snapshot.known_s = blend.known_s
    snapshot.largest_n, snapshot.reach_n = blend.largest_n, blend.reach_n
    snapshot.first_n, snapshot.low_n, snapshot.high_n = forces.first_n, forces.low_n, forces.high_n
    snapshot.recent_n, snapshot.factor = bands.recent_n(band), bands.factor(band)
    snapshot.radii_m[:] = knowledge.experts.radii_m
    snapshot.theta[:] = knowledge.experts.theta
    snapshot.weights[:] = blend.weights
