"""The haptic loop's side of the predictor: its own motion, the newest force, and a snapshot of what was
learned.

Nothing is learned here. What was said of each sample waits in a ring, until its force has arrived and the
`learner` reads it there. The loop alone writes this record, the task alone publishes snapshots.
"""

import math
from typing import Annotated, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from forefeel.common.estimation import band as bands
from forefeel.common.estimation import bank as banks
from forefeel.common.estimation import blend as blends
from forefeel.common.estimation import experts
from forefeel.common.estimation import forces as beliefs
from forefeel.common.estimation.bank import RING, Bank
from forefeel.common.estimation.blend import EARLY_S, MEMBERS, OUTSIDE, TAUGHT, ZOH
from forefeel.common.estimation.forces import Forces
from forefeel.common.estimation.regressors import fill
from forefeel.common.estimation.snapshot import Snapshot, new_snapshot
from forefeel.common.estimation.state_filter import GAP_S
from forefeel.common.jit import Array, kernel, record, zeros

_BEYOND, _EARLY_BEYOND = 0.1, 1.0  # how far a prediction may be beyond that range, as a part of it
MODELS = 2


class Estimate(NamedTuple):
    """The force now in N, its 95 % band, and the expert that led: one of `blend.NAMES`."""

    force_n: float
    low_n: float
    high_n: float
    leading: str


class Evaluation(Protocol):
    """The motion; the forces as they arrived, in order of their stamps; and by sample what was said of it.

    newest: the sample of the newest force, -1 where its motion is not known; newest_s, held_n: its stamp
    and value. heard: how many forces stand in heard_s and heard_n. rows: u of `experts`; said_n: by member;
    outside_n: what the models from outside gave; force_n, half_n, scale_n: the prediction, NaN where there
    was none, and its band.
    """

    newest: float
    newest_s: float
    held_n: float
    heard: float
    renewals: float
    bank: Bank
    forces: Forces
    heard_s: Annotated[Array, RING]
    heard_n: Annotated[Array, RING]
    rows: Annotated[Array, RING, experts.ROW]
    said_n: Annotated[Array, RING, MEMBERS]
    outside_n: Annotated[Array, RING, MODELS]
    force_n: Annotated[Array, RING]
    half_n: Annotated[Array, RING]
    scale_n: Annotated[Array, RING]
    known_row: Annotated[Array, 1, experts.ROW]


_DTYPE = record(Evaluation)
Evaluations = NDArray[np.void]
"""One record, in an array of length 1."""


class Evaluator:
    """Contact force at the own motion of now, from what a learner has published.

    It is not told the delay: it sees what arrives. Stamps are seconds on one clock, that of the own motion.
    Before any snapshot every prediction is the newest force. Costs some 2 us a tick.
    """

    def __init__(self) -> None:
        self.record = zeros(_DTYPE)
        banks.begin(self.record["bank"])
        beliefs.begin(self.record["forces"])
        self.record["newest"], self.record["newest_s"] = -1.0, -np.inf
        self.snapshot = new_snapshot()
        self._out = np.zeros(3)

    def move(
        self, t_s: float, position_m: float, identified_n: float = math.nan, loaded_n: float = math.nan
    ) -> bool:
        """The own motion at stamp `t_s`, and the forces in N of the models from outside, NaN without.

        What is not finite, or no later than the last, is left out: False. A pause over 0.1 s begins a new
        piece: what was learned stays, what the motion has left behind (hysteresis, relaxation) does not.
        """
        return _move(self.record, t_s, position_m, identified_n, loaded_n)

    def hear(self, stamp_s: float, force_n: float) -> None:
        """A force that was measured at `stamp_s`, the stamp of a `move`; an older one than the newest
        counts for nothing, and one that is far from all before waits for the next, see `forces`.
        """
        _hear(self.record, stamp_s, force_n)

    def predict(self) -> Estimate | None:
        """The force at the newest `move`; None before any force or any motion."""
        out = self._out
        if not _predict(self.record, self.snapshot, out):
            return None
        force_n, half_n, leading = out.tolist()
        return Estimate(force_n, force_n - half_n, force_n + half_n, blends.NAMES[int(leading)])

    def restart(self) -> None:
        """The next `move` begins a new piece of motion, as after a gap or a new grip."""
        self.record["bank"]["restart"] = 1.0


@kernel
def _move(records: Evaluations, t: float, x: float, identified_n: float, loaded_n: float) -> bool:
    evaluation = records[0]
    bank = evaluation.bank
    if not banks.advance(bank, t, x):
        return False
    fill(bank)
    n = int(bank.count) - 1
    i = n % RING
    evaluation.force_n[i] = math.nan
    evaluation.outside_n[i, 0], evaluation.outside_n[i, 1] = identified_n, loaded_n
    if evaluation.newest >= 0.0 and n - evaluation.newest >= RING:
        evaluation.newest = -1.0
    for j in range(banks.STOPS):
        if bank.renewed[j] > 0.0:
            experts.clear_stop(evaluation.rows, j)
    return True


@kernel
def _hear(records: Evaluations, stamp: float, force_n: float) -> None:
    evaluation = records[0]
    forces = evaluation.forces
    if stamp <= evaluation.newest_s:
        return
    count = beliefs.admit(forces, stamp, force_n)
    if forces.known == beliefs.FIRST:  # whatever was held before may be far out
        evaluation.held_n, evaluation.newest_s, evaluation.heard = forces.first_n, -math.inf, 0.0
    for k in range(count):
        _hold(evaluation, forces.admitted[k, 0], forces.admitted[k, 1])


@kernel
def _hold(evaluation: Evaluation, stamp: float, force_n: float) -> None:
    """Makes it the newest force. One without a motion must be later by a gap than one with."""
    n = banks.find(evaluation.bank, stamp)
    paired_s = evaluation.newest_s if evaluation.newest >= 0.0 else -math.inf
    if stamp <= evaluation.newest_s or (n < 0 and stamp <= paired_s + GAP_S):
        return
    evaluation.newest_s, evaluation.held_n = stamp, force_n
    evaluation.newest = float(n) if evaluation.forces.known >= beliefs.FIRST else -1.0
    place = int(evaluation.heard) % RING
    evaluation.heard_s[place], evaluation.heard_n[place] = stamp, force_n
    evaluation.heard += 1.0


@kernel
def _predict(records: Evaluations, snapshots: NDArray[np.void], out: Array) -> bool:
    """Writes (force, half width of the band, member that leads); False before any force or motion."""
    evaluation, snapshot = records[0], snapshots[0]
    n, forces = int(evaluation.bank.count) - 1, evaluation.forces
    if forces.known == 0.0 or n < 0:
        return False
    if snapshot.renewals != evaluation.renewals:
        forces.low_n, forces.high_n, evaluation.renewals = snapshot.low_n, snapshot.high_n, snapshot.renewals
    held_n, range_n = evaluation.held_n, forces.high_n - forces.low_n
    force_n, variance_n2, leading = held_n, 0.0, ZOH
    if evaluation.newest >= 0.0:
        said_n = evaluation.said_n[n % RING]
        _ask(evaluation, snapshot, n, said_n)
        force_n, variance_n2, leading = blends.mean(snapshot.weights, said_n)
        force_n = _limited(snapshot, forces, force_n, held_n)
    scale_n = bands.scale_n(snapshot.recent_n, variance_n2, force_n - held_n, range_n)
    half_n = scale_n * snapshot.factor
    if snapshot.largest_n > 0.0:
        half_n = min(half_n, snapshot.largest_n)
    elif not math.isfinite(half_n):
        half_n = range_n
    if evaluation.newest >= 0.0:
        i = n % RING
        evaluation.force_n[i], evaluation.half_n[i], evaluation.scale_n[i] = force_n, half_n, scale_n
    out[0], out[1], out[2] = force_n, half_n, leading
    return True


@kernel
def _ask(evaluation: Evaluation, snapshot: Snapshot, n: int, said_n: Array) -> None:
    """What every member of the blend says of sample n."""
    i, j, held_n = n % RING, int(evaluation.newest) % RING, evaluation.held_n
    row, known_row = evaluation.rows[i], evaluation.known_row[0]
    experts.fill(row, evaluation.bank, i, j, held_n - snapshot.first_n)
    for k in range(len(experts.LAGS_S)):
        row[experts.PAST + k] = held_n - _heard_n(evaluation, evaluation.newest_s - experts.LAGS_S[k])
    known_row[:] = row
    for k in range(banks.STOPS):
        if snapshot.radii_m[k] != evaluation.bank.radii_m[k]:
            experts.clear_stop(evaluation.known_row, k)
    said_n[ZOH] = held_n
    largest_n = max(snapshot.high_n - snapshot.first_n, snapshot.first_n - snapshot.low_n)
    members = said_n[blends.FIRST : OUTSIDE]
    experts.predict(
        members, snapshot.theta, known_row, held_n, snapshot.first_n, snapshot.largest_n, largest_n
    )
    for k in range(MODELS):
        model_n, then_n = evaluation.outside_n[i, k], evaluation.outside_n[j, k]
        said_n[OUTSIDE + 2 * k] = model_n
        said_n[OUTSIDE + 2 * k + 1] = held_n + model_n - then_n


@kernel
def _heard_n(evaluation: Evaluation, stamp: float) -> float:
    """The force of that stamp, or the last one before it; the oldest where it is earlier than all."""
    count = int(evaluation.heard)
    low, high = max(0, count - RING), count - 1
    while low < high:
        middle = (low + high + 1) // 2
        if evaluation.heard_s[middle % RING] <= stamp + 1e-7:
            low = middle
        else:
            high = middle - 1
    return float(evaluation.heard_n[low % RING])


@kernel
def _limited(snapshot: Snapshot, forces: Forces, force_n: float, held_n: float) -> float:
    """Within the reach of the newest force, see `blend`, and near the range of the forces; but as far as a
    model says that another run has taught.
    """
    beyond = _EARLY_BEYOND if snapshot.known_s < EARLY_S else _BEYOND
    taught_n = (snapshot.weights[TAUGHT] + snapshot.weights[TAUGHT + 1]) * abs(force_n - held_n)
    reach_n = max(snapshot.reach_n, taught_n)
    beyond_n = max(beyond * (forces.high_n - forces.low_n), taught_n)
    force_n = min(held_n + reach_n, max(held_n - reach_n, force_n))
    force_n = min(forces.high_n + beyond_n, max(forces.low_n - beyond_n, force_n))
    return force_n if math.isfinite(force_n) else held_n
