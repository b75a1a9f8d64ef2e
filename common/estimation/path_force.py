"""Contact force by place along the path: an elastic part and dry friction. Pure.

    f = f0 + e(x) + w(x) s,   l ds = dx within -1 <= s <= 1

e and w are linear between `NODES` places over the range of the motion. In a bent vessel how far an instrument
is bent and how hard it presses on the wall is of the place: no polynomial of the depth, as the causes of
`contact_model` have it. With rows i of weight w_i and u the values at the nodes, less those of a prior:

    J = sum w_i (f_i - f0 - phi_i' u)^2 / sigma^2 + sum_j (rho u_j^2 + lambda (u_j+1 - u_j)^2) / S^2   (1)

f0 is the mean of what a prior leaves of the force, and S its rms. Where the motion has not been yet, u fades
over a few nodes. l is the best of half octaves, with a prior that of the prior.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from forefeel.common.causes.motion import PrandtlElement
from forefeel.common.kernels.library import kernels

Array = NDArray[np.float64]

NODES = 32
_HALF_OCTAVES = range(8, 26)  # l is the range over the root of two to one of these
_TYING, _FADING = 4.0, 0.1  # lambda and rho
_OUTDONE = 0.98  # share of sigma^2 below which another l takes the place of the one of the fit before
_PASSES = 2  # of sigma: S, then what the nodes leave
_LEAST = 1e-6  # sigma^2 over S^2
_TIED = np.diff(np.eye(NODES), axis=0)
_TIES = np.kron(np.eye(2), _FADING * np.eye(NODES) + _TYING * _TIED.T @ _TIED)


@dataclass(frozen=True, slots=True)
class PathForce:
    """f0 + e and w in N at places from `low_m` on, `step_m` apart; l; sigma.

    Raises:
        ValueError: another number of places, or a length that is not above 0.
    """

    low_m: float
    step_m: float
    length_m: float
    elastic_n: tuple[float, ...]
    friction_n: tuple[float, ...]
    noise_n: float

    def __post_init__(self) -> None:
        if (len(self.elastic_n), len(self.friction_n)) != (NODES, NODES):
            raise ValueError(f"expected {NODES} places, with an elastic force and a friction each")
        if not (self.step_m > 0.0 and self.length_m > 0.0):
            raise ValueError("expected lengths above 0")

    def at(self, x_m: float, direction: float) -> float:
        """Force in N at a place, with s the direction; outside the nodes that of the nearest one."""
        place = min(max((x_m - self.low_m) / self.step_m, 0.0), NODES - 1.0)
        i = min(int(place), NODES - 2)
        e, w = self.elastic_n, self.friction_n
        before_n, after_n = e[i] + w[i] * direction, e[i + 1] + w[i + 1] * direction
        return before_n + (place - i) * (after_n - before_n)

    def along(self, x_m: Array) -> Array:
        """Force in N along positions that the motion passes in that order, with s of that motion."""
        elastic_n, friction_n = self._between(x_m)
        return elastic_n + friction_n * _direction(x_m, self.length_m)

    def nodes_n(self, places_m: Array) -> Array:
        """e and w at places, one after the other."""
        return np.concatenate(self._between(places_m))

    def _between(self, x_m: Array) -> tuple[Array, Array]:
        at = (x_m - self.low_m) / self.step_m
        i = np.arange(NODES)
        return np.interp(at, i, self.elastic_n), np.interp(at, i, self.friction_n)


def path_force(
    x_m: Array, force_n: Array, weights: Array, before: PathForce | None, prior: PathForce | None = None
) -> PathForce | None:
    """Fits the force by place to forces at positions, in their order, by (1); None where position or force
    does not vary. Tries a grid of lengths l and that of `before`, the last fit, which is favoured. With a
    prior the fit is a change of that, of its l.
    """
    low_m, range_m, total = float(np.min(x_m)), float(np.ptp(x_m)), float(np.sum(weights))
    if not (range_m > 0.0 and total > 0.0):
        return None
    if prior is not None:
        high_m = max(low_m + range_m, prior.low_m + (NODES - 1) * prior.step_m)
        low_m = min(low_m, prior.low_m)
        range_m = high_m - low_m
        force_n = force_n - prior.along(x_m)
    mean_n = float(weights @ force_n) / total
    left_n = force_n - mean_n
    power_n2 = float(weights @ left_n**2) / total
    if power_n2 <= 0.0:
        return None
    step_m = range_m / (NODES - 1)
    places = (x_m - low_m) / step_m
    ties = _TIES / power_n2
    best_n2, best_m = np.inf, 0.0
    best_u: Array = np.zeros(2 * NODES)
    octaves_m = [2.0 ** (-0.5 * n) * range_m for n in _HALF_OCTAVES]
    lengths_m = octaves_m if before is None else [before.length_m, *octaves_m]
    for length_m in lengths_m if prior is None else [prior.length_m]:
        direction = _direction(x_m, length_m)
        gram, moments = _normal_equations(places, direction, left_n, weights)
        noise_n2 = power_n2
        for _ in range(_PASSES):
            u = np.linalg.solve(gram / noise_n2 + ties, moments / noise_n2)
            rest_n2 = power_n2 - float(2.0 * u @ moments - u @ gram @ u) / total
            noise_n2 = max(rest_n2, _LEAST * power_n2)
        favoured = before is not None and length_m == before.length_m
        if noise_n2 * (_OUTDONE if favoured else 1.0) < best_n2:
            best_n2, best_m, best_u = noise_n2, length_m, np.asarray(u, dtype=np.float64)
    if best_m <= 0.0:  # not finite
        return None
    nodes_m = np.asarray(low_m + step_m * np.arange(NODES), dtype=np.float64)
    elastic_n, friction_n = (best_u if prior is None else best_u + prior.nodes_n(nodes_m)).reshape(2, NODES)
    nodes_n = tuple((mean_n + elastic_n).tolist()), tuple(friction_n.tolist())
    return PathForce(low_m, step_m, best_m, *nodes_n, best_n2**0.5)


def _direction(x_m: Array, length_m: float) -> Array:
    return PrandtlElement.run(np.diff(x_m, prepend=x_m[:1]) / length_m)


def _normal_equations(places: Array, direction: Array, left_n: Array, weights: Array) -> tuple[Array, Array]:
    """phi' W phi and phi' W f of rows at places in steps."""
    gram, moments = np.zeros((2 * NODES, 2 * NODES)), np.zeros(2 * NODES)
    rows = places, direction, left_n, np.ascontiguousarray(weights)
    addresses = [values.ctypes.data for values in (*rows, gram, moments)]
    kernels().path_normal_equations(*addresses, len(places))
    return gram, moments
