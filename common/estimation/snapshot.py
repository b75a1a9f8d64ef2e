"""All that the identification task has learned, as it gives it to the haptic loop: nobody changes it."""

from typing import Annotated, Protocol

import numpy as np
from numpy.typing import NDArray

from forefeel.common.estimation import experts
from forefeel.common.estimation.bank import STOPS
from forefeel.common.estimation.blend import MEMBERS, ZOH
from forefeel.common.jit import Array, record, zeros


class Snapshot(Protocol):
    """theta by expert, learned with stops of the radii `radii_m`; weights by member of the blend; f0, range
    of the forces, largest error of the zero-order hold L, reach, time judged T; of the band the recent error
    and the factor.

    renewals: how often the learner has begun anew.
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
    radii_m: Annotated[Array, STOPS]
    theta: Annotated[Array, len(experts.NAMES), experts.ROW]
    weights: Annotated[Array, MEMBERS]


_DTYPE = record(Snapshot)


def new_snapshot() -> NDArray[np.void]:
    """One that knows nothing: the zero-order hold has all the weight."""
    snapshot = zeros(_DTYPE)
    snapshot["weights"][:, ZOH] = 1.0
    snapshot["factor"] = np.inf
    return snapshot
