"""Arrivals of the force of each sample at the master: delay, jitter and loss, repeatable by a seed."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from forefeel.common.error_size import Floats
from forefeel.common.errors import ConfigurationError

Indices = NDArray[np.int64]

# s, longest `delay_s` and longest `jitter_s`; both together are `methods.LONGEST_LATENESS_S`
LONGEST_S = 30.0


@dataclass(frozen=True, slots=True)
class DelayedLink:
    """The way of a force to the master.

    Attributes:
        delay_s: from the motion to the arrival of the force that it caused.
        jitter_s: each force is earlier or later by up to this, uniformly and independently; none before its
            own stamp.
        loss: probability that a force never arrives, independently.
        seed: of jitter and loss, the same for every recording.

    Raises:
        ConfigurationError: a value out of its range.
    """

    delay_s: float
    jitter_s: float = 0.0
    loss: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        for name, value in ("delay_s", self.delay_s), ("jitter_s", self.jitter_s):
            if not 0.0 <= value <= LONGEST_S:
                raise ConfigurationError(f"{name} = {value:g}: expected 0 to {LONGEST_S:g} s")
        if not 0.0 <= self.loss < 1.0:
            raise ConfigurationError(
                f"loss = {self.loss:g}: expected a probability from 0 to below 1, 0.01 for 1 %"
            )
        if self.seed < 0:
            raise ConfigurationError(f"seed = {self.seed}: expected 0 or more")


@dataclass(frozen=True, slots=True)
class Arrivals:
    """Forces that have reached a master at each of its n stamps.

    Attributes:
        order: indices of the samples whose force arrives within the recording, by time of arrival.
        edges: shape (n + 1,); `order[edges[k]:edges[k + 1]]` arrive after stamp k - 1, up to stamp k.
    """

    order: Indices
    edges: Indices

    def batches(self) -> list[list[int]]:
        order, edges = self.order.tolist(), self.edges.tolist()
        return [order[start:stop] for start, stop in pairwise(edges)]


def arrivals(time_s: Floats, link: DelayedLink) -> Arrivals:
    """Draws the arrivals over the link of the forces stamped `time_s` (increasing), grouped by the stamp at
    which they are first known; without those lost or later than the last stamp. Repeatable by `link.seed`.

    Sample i has arrived at the stamp t if time_s[i] <= t - latency_i, computed so: without jitter that is the
    comparison by which a zero-order hold is defined, to the last bit.
    """
    n = len(time_s)
    random = np.random.default_rng(link.seed)
    jitter_s = random.uniform(-link.jitter_s, link.jitter_s, n)
    lost = random.random(n) < link.loss
    latency_s = np.maximum(link.delay_s + jitter_s, 0.0)
    first = _first_seen(time_s, latency_s)
    arriving = np.flatnonzero(~lost & (first < n))
    order = arriving[np.lexsort(((time_s + latency_s)[arriving], first[arriving]))]
    edges = np.searchsorted(first[order], np.arange(n + 1))
    return Arrivals(order, edges.astype(np.int64))


def _first_seen(time_s: Floats, latency_s: Floats) -> Indices:
    """Smallest k with time_s[i] <= time_s[k] - latency_s[i], for each i; n where there is none."""
    n = len(time_s)
    first = np.searchsorted(time_s, time_s + latency_s).astype(np.int64)
    # the sum above and the difference of the definition round differently: by one stamp at most
    before = np.maximum(first - 1, 0)
    first = np.where((first > 0) & (time_s <= time_s[before] - latency_s), before, first)
    at = np.minimum(first, n - 1)
    return np.where((first < n) & (time_s > time_s[at] - latency_s), first + 1, first)
