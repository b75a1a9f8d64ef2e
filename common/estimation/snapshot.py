"""All that the identification task has learned, as it gives it to the haptic loop. Nobody changes it."""

from dataclasses import dataclass
from typing import Annotated, Protocol

import numpy as np
from numpy.typing import NDArray

from forefeel.common.estimation import experts
from forefeel.common.estimation.bank import STOPS
from forefeel.common.estimation.blend import MEMBERS, ZOH
from forefeel.common.estimation.contact import Contact
from forefeel.common.jit import Array, record, zeros


class Learned(Protocol):
    """theta by expert, learned with stops of the radii `radii_m`; weights by member of the blend, and which
    of them another run has taught; f0, range of the forces, largest error of the zero-order hold L, reach,
    time judged T; of the band the recent error and the factor.

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
    taught: Annotated[Array, MEMBERS]


_DTYPE = record(Learned)


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """`learned`: one record of `Learned`, in an array. `contact`: None before any is known."""

    learned: NDArray[np.void]
    contact: Contact | None


def nothing_learned() -> NDArray[np.void]:
    """The zero-order hold has all the weight."""
    learned = zeros(_DTYPE)
    learned["weights"][:, ZOH] = 1.0
    learned["factor"] = np.inf
    return learned
