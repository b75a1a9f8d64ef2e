"""Everything that the predictor knows, in one record."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from forefeel.common.estimation.forecast import band as bands
from forefeel.common.estimation.forecast import bank as banks
from forefeel.common.estimation.forecast import change as changes
from forefeel.common.estimation.forecast import experts as crowd
from forefeel.common.estimation.forecast import hold as holds
from forefeel.common.estimation.forecast import regression as fits
from forefeel.common.estimation.forecast import trial as trials
from forefeel.common.estimation.forecast.bank import RING, Array
from forefeel.common.jit import floats, record, zeros

_RINGS = ("forces_n", "blends_n", "holds_n", "sayings_n", "halves_n", "scales_n")
_MEMORY = record(
    "known newest newest_s held_n low_n high_n before_n suspect_s suspect_n fastest_n_s said_n said_s",
    *(floats(name, RING) for name in _RINGS),
)
DTYPE = np.dtype(
    [
        ("bank", banks.DTYPE),
        ("regression", fits.DTYPE),
        ("experts", crowd.DTYPE),
        ("gain", holds.DTYPE),
        ("band", bands.DTYPE),
        ("change", changes.DTYPE),
        ("trial", trials.DTYPE),
        ("memory", _MEMORY),
    ],
    align=True,
)


class Memory(Protocol):
    """A record: what has been seen, and by sample the force (NaN until it has come) and what was said of it.

    known: forces seen. newest_s, held_n: stamp and value of the newest; newest: its sample, -1 where its
    motion is not known. low_n, high_n: range of the forces. before_n: the force seen last; suspect_*: the
    same where it is out of reach, else NaN. fastest_n_s: the fastest change of force, fading. said_*: the
    last prediction. Where nothing was said of a sample, `sayings_n` is NaN, and blends, holds, halves (of the
    band's width) and scales are left from another.
    """

    known: float
    newest: float
    newest_s: float
    held_n: float
    low_n: float
    high_n: float
    before_n: float
    suspect_s: float
    suspect_n: float
    fastest_n_s: float
    said_n: float
    said_s: float
    forces_n: Array
    blends_n: Array
    holds_n: Array
    sayings_n: Array
    halves_n: Array
    scales_n: Array


class State(Protocol):
    """A record of `DTYPE`: everything that the predictor knows."""

    bank: banks.Bank
    regression: fits.Regression
    experts: crowd.Experts
    gain: holds.Gain
    band: bands.Band
    change: changes.Change
    trial: trials.Trial
    memory: Memory


def new_state(outside: int) -> NDArray[np.void]:
    """One state that knows nothing, in an array. `outside`: how many models from outside take part."""
    state = zeros(DTYPE)
    banks.begin(state["bank"])
    fits.begin(state["regression"])
    crowd.begin(state["experts"], outside)
    bands.begin(state["band"])
    trials.begin(state["trial"])
    memory = state["memory"]
    memory["suspect_n"] = np.nan
    memory["newest"], memory["newest_s"], memory["said_s"] = -1.0, -np.inf, -np.inf
    return state
