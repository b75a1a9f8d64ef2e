"""A wall whose stiffness changes with depth."""

import numpy as np

from forefeel.common.causes.base import ForceEffect, Parameter
from forefeel.common.causes.candidate import (
    Entry,
    Extent,
    ForceColumns,
    Found,
    MotionGrid,
    Shape,
    Values,
    entry,
    log_grid,
)
from forefeel.common.causes.exponential_wall import ExponentialWall
from forefeel.common.causes.offline import Array


def _powers(motion: MotionGrid, _shape: Shape) -> list[Array]:
    return [motion.x**2, motion.x**3]


def _exponential(motion: MotionGrid, shape: Shape) -> list[Array]:
    return [ExponentialWall(length_m=shape[0]).columns(motion.t, motion.x, motion.v, motion.a)[:, 0]]


def _depths(extent: Extent) -> list[Shape]:
    return log_grid(0.12 * extent.reach_m, 1.5 * extent.reach_m, 6)


def _series(found: Found) -> Values:
    """The exponential with its second and third order."""
    (force_n,), (length_m,) = found.coefficients, found.shape
    return {
        "quadratic_n_m2": force_n / (2.0 * length_m**2), "cubic_n_m3": force_n / (6.0 * length_m**3),
        "exponential_n": force_n, "length_m": length_m,
    }  # fmt: skip


def _wall(found: Found) -> list[Entry]:
    return [entry(ExponentialWall, _series(found))]


class Stiffening(ForceEffect):
    """`f = k2 x^2 + k3 x^3`."""

    name = "stiffening"
    site = "wall"
    parameters = (
        Parameter("quadratic_n_m2", "N/m^2", 0.0, -1e9, 1e9),
        Parameter("cubic_n_m3", "N/m^3", 0.0, -1e12, 1e12),
    )
    reference = "polynomial restoring force, Duffing, Erzwungene Schwingungen, 1918"
    fingerprint = "a curve over position, the same on the way in and out and at any speed"
    words = "a spring whose stiffness changes with depth"
    equation = (
        "{quadratic_n_m2} x^2 + {cubic_n_m3} x^3",
        "{exponential_n} (exp(x/{length_m}) - 1)",
    )
    candidates = (
        ForceColumns(
            coefficients=("quadratic_n_m2", "cubic_n_m3"), signs=(0, 0), columns=_powers, at_wall=True,
            picture="position",
        ),
        ForceColumns(
            form="exponential", signs=(1,), columns=_exponential, grid=_depths, at_wall=True, naming=_series,
            sizes=("exponential_n",), making=_wall, picture="position",
        ),
    )  # fmt: skip

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(x^2, x^3)."""
        square = x * x
        return (square, square * x)

    def _columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        square = x * x
        return np.stack((square, square * x)).T
