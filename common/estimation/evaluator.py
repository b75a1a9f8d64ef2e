"""The haptic loop's side of the predictor: its own motion, the newest force, and a snapshot of the learner.

Nothing is learned here. The predictions of each sample wait in a ring until its force has arrived and the
`learner` reads them. The loop alone writes this record, the task alone publishes snapshots.
"""

import math
from dataclasses import dataclass
from typing import Annotated, NamedTuple, Protocol

import numpy as np

from forefeel.common.causes.motion import NO_COLUMNS, Columns
from forefeel.common.estimation import bank as banks
from forefeel.common.estimation import blend as blends
from forefeel.common.estimation import experts
from forefeel.common.estimation import forces as forces_
from forefeel.common.estimation.bank import RING, Bank
from forefeel.common.estimation.blend import MEMBERS, ZOH
from forefeel.common.estimation.contact import Contact, ContactExpert
from forefeel.common.estimation.forces import Forces
from forefeel.common.estimation.state_filter import GAP_S, StateFilter
from forefeel.common.kernels.library import kernels
from forefeel.common.kernels.record import Array, Numbers, Record

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
    1 while another run has taught the contact; persistence: rho of `blend`; f0, range of the forces, largest
    error of the zero-order hold L, reach, time judged T; of the band the recent error and the factor.

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
    taught: float
    persistence: float
    radii_m: Annotated[Array, banks.STOPS]
    theta: Annotated[Array, len(experts.NAMES), experts.ROW]
    weights: Annotated[Array, MEMBERS]


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """All that the learner has learned, for the evaluator; immutable.

    `learned`: a record of `Learned`. `contact`: None before any is known. `band_known`: a prediction has been
    compared with its force. `taught`: the contact as a prior or a model.yaml gave it, else None.
    """

    learned: Record
    contact: Contact | None
    band_known: bool = False
    taught: Contact | None = None


def nothing_learned() -> Record:
    """A record of `Learned` in which the zero-order hold has all the weight."""
    learned = Record(Learned)
    learned.values["weights"][ZOH] = 1.0
    learned.values["factor"] = np.inf
    learned.values["persistence"] = 1.0
    return learned


class Evaluation(Protocol):
    """The motion; the forces as they arrived, in order of their stamps; and the predictions by sample.

    newest: the sample of the newest force, -1 if its motion is not known; newest_s, held_n: its stamp and
    value. received: number of forces in received_s and received_n. stage: expected position, velocity and
    acceleration. taught_n: the largest force so far of the contact as taught. contact_n: force of the
    contact; steadily_n: the same without the steps from one fit to the next; residual_n: what it left of the
    force then newest. rows: u of `experts`; members_n: predictions by member; others_n: the prediction
    without a taught contact; force_n, half_n, scale_n: the prediction, NaN without one, and its band.
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
    residual_n: Annotated[Array, RING]
    rows: Annotated[Array, RING, experts.ROW]
    members_n: Annotated[Array, RING, MEMBERS]
    others_n: Annotated[Array, RING]
    force_n: Annotated[Array, RING]
    half_n: Annotated[Array, RING]
    scale_n: Annotated[Array, RING]
    known_row: Annotated[Array, 1, experts.ROW]


class OwnMotion(Protocol):
    """Own motion at t_s: setpoint; expected position, velocity and acceleration of the stage; force of the
    contact, the same without steps, and as taught.
    """

    t_s: float
    x_m: float
    stage_m: float
    v_m_s: float
    a_m_s2: float
    contact_n: float
    steadily_n: float
    taught_n: float


class Reading(Protocol):
    """A force and the stamp of the motion that it answers."""

    stamp_s: float
    force_n: float


class Predicted(Protocol):
    """The prediction, NaN before any force or any motion; half the width of its band; the leading member."""

    force_n: float
    half_n: float
    leading: float


class Evaluator:
    """Predicts the contact force at the newest own motion, from the snapshot of a learner.

    The delay follows from the forces that arrive. Stamps are seconds on one clock, that of the own motion.
    Before any snapshot every prediction is the newest force. One thread calls; a learner in another one reads
    `moved_s` and the record.

    Attributes:
        record: of `Evaluation`. further: columns beside the motion, by place in its ring.
    """

    def __init__(self) -> None:
        self.record = Record(Evaluation)
        self.further: list[Columns] = [NO_COLUMNS] * RING
        values = self.record.values
        banks.begin(values["bank"])
        forces_.begin(values["forces"])
        values["newest"], values["newest_s"] = -1.0, -np.inf
        self._kernels, self._address = kernels(), self.record.address
        self._own_motion, self._reading, self._predicted = map(Numbers, (OwnMotion, Reading, Predicted))
        self.snapshot = Snapshot(nothing_learned(), None)
        self._expert = ContactExpert()
        self._used: Contact | None = None
        self._taught_expert = ContactExpert()
        self._taught: Contact | None = None
        self._velocity = StateFilter(_CUTOFF_HZ)
        self._moved_s = -math.inf

    def move(
        self,
        t_s: float,
        position_m: float,
        stage_m: float,
        velocity_m_s: float,
        further: Columns = NO_COLUMNS,
    ) -> None:
        """Adds the own motion at stamp `t_s`: setpoint and expected stage position in m, velocity in m/s;
        `further`: the columns that the contact's model follows beside.

        Computes the contact's force there, and takes over a new contact of the snapshot. Ignores a motion
        that is not finite or no later than the last. A pause over 0.1 s begins a new piece: what was learned
        stays, the states of the motion (hysteresis, relaxation) do not.
        """
        dt_s = t_s - self._moved_s
        motion = t_s + position_m + stage_m + velocity_m_s + sum(further.values())
        if not (dt_s > 0.0 and math.isfinite(motion)):
            return
        self._moved_s = t_s
        contact = self.snapshot.contact
        if contact is not None and contact is not self._used:
            self._used = contact
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
            contact_n = self._expert.move(t_s, *stage, dt_s, further)
            taught_n = self._taught_expert.move(t_s, *stage, dt_s, further)
        steadily_n = contact_n + self._expert.steps_n
        if further:
            self.further[int(self.record.values["bank"]["count"]) % RING] = further
        self._own_motion.pack(t_s, position_m, *stage, contact_n, steadily_n, taught_n)
        self._kernels.evaluator_move(self._address, self._own_motion.address)

    def hear(self, stamp_s: float, force_n: float) -> None:
        """Adds a force that was measured at `stamp_s`, the stamp of a `move`. Ignores one older than the
        newest; one far from all before waits until the next confirms it, see `forces`.
        """
        self._reading.pack(stamp_s, force_n)
        self._kernels.evaluator_receive(self._address, self._reading.address)

    def predict(self) -> Estimate | None:
        """Predicts and records the force at the newest `move`; None before any force or any motion."""
        learned, predicted = self.snapshot.learned, self._predicted
        self._kernels.evaluator_predict(self._address, learned.address, predicted.address)
        force_n, half_n, leading = predicted.unpack()
        if math.isnan(force_n):
            return None
        return Estimate(force_n, force_n - half_n, force_n + half_n, blends.NAMES[int(leading)])

    @property
    def moved_s(self) -> float:
        """Stamp of the newest motion."""
        stamp_s: float = self._kernels.evaluator_moved_s(self._address)
        return stamp_s

    def restart(self) -> None:
        """Begins a new piece of motion with the next `move`, as after a gap or a new grip."""
        self._moved_s = -math.inf
        self.record.values["bank"]["restart"] = 1.0
