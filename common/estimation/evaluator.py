"""The haptic loop's side of the predictor: its own motion, the newest force, and a snapshot of the learner.

Nothing is learned here. The predictions of each sample wait in a ring until its force has arrived and the
`learner` reads them. The loop alone writes this record, the task alone publishes snapshots.
"""

import math
from dataclasses import dataclass
from typing import Annotated, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from forefeel.common.estimation import band as bands
from forefeel.common.estimation import bank as banks
from forefeel.common.estimation import blend as blends
from forefeel.common.estimation import experts
from forefeel.common.estimation import forces as beliefs
from forefeel.common.estimation.bank import RING, Bank
from forefeel.common.estimation.blend import CONTACT, EARLY_S, MEMBERS, ZOH
from forefeel.common.estimation.contact import Contact, ContactExpert
from forefeel.common.estimation.forces import Forces
from forefeel.common.estimation.state_filter import GAP_S, StateFilter
from forefeel.common.jit import Array, kernel, record, zeros

_BEYOND, _EARLY_BEYOND = 0.1, 1.0  # distance of a prediction beyond the range of the forces, over that range
# Limit over the larger of the forces so far and those that the contact as taught predicts: right predictions
# reach 9 times the first alone, as a first push is many times the noise, and 1.2 times the larger.
_MOST = 2.0
# Hz, cutoff of the contact's velocity: a lag of 8 ms, below the 15 ms at which a delayed damper is felt. The
# velocity is advanced by it: a friction that turns 8 ms late at every reversal helps a third less.
_CUTOFF_HZ = 40.0
_LEAD_S = 2.0 / (2.0 * math.pi * _CUTOFF_HZ)


class Estimate(NamedTuple):
    """The force now in N, its 95 % band, and the leading expert: one of `blend.NAMES`. A rival in an
    evaluation has neither: NaN and empty.
    """

    force_n: float
    low_n: float = math.nan
    high_n: float = math.nan
    leading: str = ""


class Learned(Protocol):
    """theta by expert, learned with stops of the radii `radii_m`; weights by member of the blend; taught:
    1 if another run has taught it; f0, range of the forces, largest error of the zero-order hold L, reach,
    time judged T; of the band the recent error and the factor.

    renewals: number of times that the learner has begun anew.
    """

    renewals: float
    known_s: float
    first_n: float
    low_n: float
    high_n: float
    largest_n: float
    reach_n: float
    recent_n: float
    factor: float
    radii_m: Annotated[Array, banks.STOPS]
    theta: Annotated[Array, len(experts.NAMES), experts.ROW]
    weights: Annotated[Array, MEMBERS]
    taught: Annotated[Array, MEMBERS]


_LEARNED = record(Learned)


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """All that the learner has learned, for the evaluator; immutable.

    `learned`: one record of `Learned`, in an array. `contact`: None before any is known. `band_known`: True
    once a prediction has been compared with its force. `taught`: the contact as a prior or a model.yaml gave
    it, else None.
    """

    learned: NDArray[np.void]
    contact: Contact | None
    band_known: bool = False
    taught: Contact | None = None


def nothing_learned() -> NDArray[np.void]:
    """A record of `Learned` in which the zero-order hold has all the weight."""
    learned = zeros(_LEARNED)
    learned["weights"][:, ZOH] = 1.0
    learned["factor"] = np.inf
    return learned


class Evaluation(Protocol):
    """The motion; the forces as they arrived, in order of their stamps; and the predictions by sample.

    newest: the sample of the newest force, -1 if its motion is not known; newest_s, held_n: its stamp and
    value. received: number of forces in received_s and received_n. stage: expected position, velocity and
    acceleration. taught_n: the largest force so far of the contact as taught. contact_n: force of the
    contact; steadily_n: the same without the steps from one fit to the next. rows: u of `experts`; members_n:
    predictions by member; force_n, half_n, scale_n: the prediction, NaN without one, and its band.
    """

    newest: float
    newest_s: float
    held_n: float
    received: float
    renewals: float
    taught_n: float
    bank: Bank
    forces: Forces
    received_s: Annotated[Array, RING]
    received_n: Annotated[Array, RING]
    stage: Annotated[Array, RING, 3]
    contact_n: Annotated[Array, RING]
    steadily_n: Annotated[Array, RING]
    rows: Annotated[Array, RING, experts.ROW]
    members_n: Annotated[Array, RING, MEMBERS]
    force_n: Annotated[Array, RING]
    half_n: Annotated[Array, RING]
    scale_n: Annotated[Array, RING]
    known_row: Annotated[Array, 1, experts.ROW]


_DTYPE = record(Evaluation)
Evaluations = NDArray[np.void]
"""One record, in an array of length 1."""


class Evaluator:
    """Predicts the contact force at the newest own motion, from the snapshot of a learner.

    The delay follows from the forces that arrive. Stamps are seconds on one clock, that of the own motion.
    Before any snapshot every prediction is the newest force.
    """

    def __init__(self) -> None:
        self.record = zeros(_DTYPE)
        banks.begin(self.record["bank"])
        beliefs.begin(self.record["forces"])
        self.record["newest"], self.record["newest_s"] = -1.0, -np.inf
        self.snapshot = Snapshot(nothing_learned(), None)
        self._expert = ContactExpert()
        self._used: Contact | None = None
        self._taught_expert = ContactExpert()
        self._taught: Contact | None = None
        self._velocity = StateFilter(_CUTOFF_HZ)
        self._moved_s = -math.inf
        self._contact_n = math.nan
        self._steps_n = 0.0

    def move(self, t_s: float, position_m: float, stage_m: float, velocity_m_s: float) -> None:
        """Adds the own motion at stamp `t_s`: setpoint and expected stage position in m, velocity in m/s.

        Computes the contact's force there, and takes over a new contact of the snapshot. Ignores a motion
        that is not finite or no later than the last. A pause over 0.1 s begins a new piece: what was learned
        stays, the states of the motion (hysteresis, relaxation) do not.
        """
        dt_s = t_s - self._moved_s
        if not (dt_s > 0.0 and math.isfinite(t_s + position_m + stage_m + velocity_m_s)):
            return
        self._moved_s = t_s
        contact, renewed = self.snapshot.contact, False
        if contact is not None and contact is not self._used:
            self._used, renewed = contact, True
            self._expert.use(contact)
        taught = self.snapshot.taught
        if taught is not None and taught is not self._taught:
            self._taught = taught
            self._taught_expert.use(taught)
        if dt_s > GAP_S:
            self._velocity.reset()
            self._expert.reset()
            self._taught_expert.reset()
        v, a, _ = self._velocity.step(velocity_m_s, dt_s)
        stage = (stage_m, v + _LEAD_S * a, a)
        contact_n = taught_n = math.nan
        if dt_s <= GAP_S:
            contact_n = self._expert.move(t_s, *stage, dt_s)
            taught_n = self._taught_expert.move(t_s, *stage, dt_s)
        if renewed and math.isfinite(self._contact_n - contact_n):
            self._steps_n += self._contact_n - contact_n
        self._contact_n = contact_n
        _move(self.record, t_s, position_m, stage, (contact_n, contact_n + self._steps_n, taught_n))

    def hear(self, stamp_s: float, force_n: float) -> None:
        """Adds a force that was measured at `stamp_s`, the stamp of a `move`. It is ignored if older than the
        newest one; if far from all before, it waits until the next confirms it, see `forces`.
        """
        _receive(self.record, stamp_s, force_n)

    def predict(self) -> Estimate | None:
        """Predicts and records the force at the newest `move`; None before any force or any motion."""
        force_n, half_n, leading = _predict(self.record, self.snapshot.learned)
        if math.isnan(force_n):
            return None
        return Estimate(force_n, force_n - half_n, force_n + half_n, blends.NAMES[leading])

    def restart(self) -> None:
        """Begins a new piece of motion with the next `move`, as after a gap or a new grip."""
        self._moved_s = -math.inf
        self.record["bank"]["restart"] = 1.0


@kernel
def _move(
    records: Evaluations,
    t: float,
    x: float,
    stage: tuple[float, float, float],
    contact_n: tuple[float, float, float],
) -> None:
    """Adds a sample to the record: position x, its phi, and the stage's position, velocity and acceleration.

    `contact_n`: force of the contact in N, without the steps between fits, and as taught. Does nothing if t
    does not increase. Clears the rows of stops with a new radius; `newest` becomes -1 if its sample has left
    the ring.
    """
    evaluation = records[0]
    bank = evaluation.bank
    if not banks.advance(bank, t, x):
        return
    banks.fill(bank)
    n = int(bank.count) - 1
    i = n % RING
    evaluation.force_n[i] = math.nan
    evaluation.stage[i, 0], evaluation.stage[i, 1], evaluation.stage[i, 2] = stage
    evaluation.contact_n[i], evaluation.steadily_n[i], taught_n = contact_n
    if not math.isnan(taught_n):
        evaluation.taught_n = max(evaluation.taught_n, abs(taught_n))
    if evaluation.newest >= 0.0 and n - evaluation.newest >= RING:
        evaluation.newest = -1.0
    for j in range(banks.STOPS):
        if bank.renewed[j] > 0.0:
            experts.clear_stop(evaluation.rows, j)


@kernel
def _receive(records: Evaluations, stamp: float, force_n: float) -> None:
    """Adds a force in N to the record if the outlier check `admit` accepts it, with one that it confirms.

    Ignores one no later than the newest. The third force discards those before it, and their median stands
    for them.
    """
    evaluation = records[0]
    forces = evaluation.forces
    if stamp <= evaluation.newest_s:
        return
    count = beliefs.admit(forces, stamp, force_n)
    if forces.known == beliefs.FIRST:  # a force that was held before may be far out
        evaluation.held_n, evaluation.newest_s, evaluation.received = forces.first_n, -math.inf, 0.0
    for k in range(count):
        _hold(evaluation, forces.admitted[k, 0], forces.admitted[k, 1])


@kernel
def _hold(evaluation: Evaluation, stamp: float, force_n: float) -> None:
    """Makes a force the newest, and adds it to those received, if it is later; else does nothing.

    One without a motion at its stamp has to be over 0.1 s later than a newest one with a motion. `newest` is
    its sample, -1 without a motion or before three forces.
    """
    n = banks.find(evaluation.bank, stamp)
    paired_s = evaluation.newest_s if evaluation.newest >= 0.0 else -math.inf
    if stamp <= evaluation.newest_s or (n < 0 and stamp <= paired_s + GAP_S):
        return
    evaluation.newest_s, evaluation.held_n = stamp, force_n
    evaluation.newest = float(n) if evaluation.forces.known >= beliefs.FIRST else -1.0
    place = int(evaluation.received) % RING
    evaluation.received_s[place], evaluation.received_n[place] = stamp, force_n
    evaluation.received += 1.0


@kernel
def _predict(records: Evaluations, learneds: NDArray[np.void]) -> tuple[float, float, int]:
    """Predicts the force at the newest motion; returns (N, half the width of its band, index of the leader).

    Both are NaN before any force or motion. The mean of the members is cut by `_limited` and to twice the
    largest force; if the motion of the newest force is not known, that force is predicted. Records what it
    predicts for the learner, and takes over its range of forces after it has begun anew.
    """
    evaluation, learned = records[0], learneds[0]
    n, forces = int(evaluation.bank.count) - 1, evaluation.forces
    if forces.known == 0.0 or n < 0:
        return math.nan, math.nan, ZOH
    if learned.renewals != evaluation.renewals:
        forces.low_n, forces.high_n, evaluation.renewals = learned.low_n, learned.high_n, learned.renewals
        evaluation.steadily_n[:] = math.nan  # of a contact that was dropped
    held_n, range_n = evaluation.held_n, forces.high_n - forces.low_n
    force_n, variance_n2, leading, cut_n = held_n, 0.0, ZOH, 0.0
    if evaluation.newest >= 0.0:
        members_n = evaluation.members_n[n % RING]
        _predict_members(evaluation, learned, n, members_n)
        force_n, variance_n2, leading = blends.mean(learned.weights, members_n)
        limited_n = _limited(learned, forces, force_n, held_n)
        first_n = forces.first_n
        most_n = _MOST * max(forces.high_n - first_n, first_n - forces.low_n, evaluation.taught_n)
        force_n = min(first_n + most_n, max(first_n - most_n, limited_n))
        cut_n = min(abs(limited_n - force_n), most_n)
    scale_n = bands.scale_n(learned.recent_n, variance_n2, force_n - held_n, range_n)
    half_n = scale_n * learned.factor
    if learned.largest_n > 0.0:
        half_n = min(half_n, max(learned.largest_n, abs(force_n - held_n)))
    elif not math.isfinite(half_n):
        half_n = range_n
    half_n = max(half_n, cut_n)
    if evaluation.newest >= 0.0:
        i = n % RING
        evaluation.force_n[i], evaluation.half_n[i], evaluation.scale_n[i] = force_n, half_n, scale_n
    return force_n, half_n, leading


@kernel
def _predict_members(evaluation: Evaluation, learned: Learned, n: int, members_n: Array) -> None:
    """Sets `members_n`, the members' predictions in N at sample n, and row u, from which the experts predict.

    Members: the newest force, the experts, the contact, and the newest force with the contact's change since;
    NaN where there is no contact. A contact not taught is cut to the range of forces and its width beyond.
    """
    i, j, held_n = n % RING, int(evaluation.newest) % RING, evaluation.held_n
    row, known_row = evaluation.rows[i], evaluation.known_row[0]
    experts.fill(row, evaluation.bank, i, j, held_n - learned.first_n)
    for k in range(len(experts.LAGS_S)):
        past_s = evaluation.newest_s - experts.LAGS_S[k]
        past = banks.last_until(evaluation.received_s, int(evaluation.received), past_s)
        row[experts.PAST + k] = held_n - evaluation.received_n[past % RING]
    known_row[:] = row
    for k in range(banks.STOPS):
        if learned.radii_m[k] != evaluation.bank.radii_m[k]:
            experts.clear_stop(evaluation.known_row, k)
    members_n[ZOH] = held_n
    largest_n = max(learned.high_n - learned.first_n, learned.first_n - learned.low_n)
    expert_n = members_n[blends.FIRST : CONTACT]
    experts.predict(expert_n, learned.theta, known_row, held_n, learned.first_n, learned.largest_n, largest_n)
    members_n[CONTACT] = evaluation.contact_n[i]
    members_n[CONTACT + 1] = held_n + evaluation.steadily_n[i] - evaluation.steadily_n[j]
    forces = evaluation.forces
    range_n = forces.high_n - forces.low_n
    for e in range(CONTACT, MEMBERS):
        if learned.taught[e] == 0.0 and not math.isnan(members_n[e]):
            members_n[e] = min(forces.high_n + range_n, max(forces.low_n - range_n, members_n[e]))


@kernel
def _limited(learned: Learned, forces: Forces, force_n: float, held_n: float) -> float:
    """Returns a prediction cut to the reach about the newest force, `held_n`, and to near the range of all.

    Near: beyond that range by 0.1 of its width, in the first 5 s by all of it. Members that another run has
    taught widen both by their weight. Returns `held_n` if the prediction is not finite.
    """
    beyond = _EARLY_BEYOND if learned.known_s < EARLY_S else _BEYOND
    taught_n = (learned.weights * learned.taught).sum() * abs(force_n - held_n)
    reach_n = max(learned.reach_n, taught_n)
    beyond_n = max(beyond * (forces.high_n - forces.low_n), taught_n)
    force_n = min(held_n + reach_n, max(held_n - reach_n, force_n))
    force_n = min(forces.high_n + beyond_n, max(forces.low_n - beyond_n, force_n))
    return force_n if math.isfinite(force_n) else held_n
