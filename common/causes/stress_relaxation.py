"""A force that fades while the instrument is held still."""

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
    two,
)
from forefeel.common.causes.first_order import FirstOrderLag, lagged
from forefeel.common.causes.offline import Array


def _branch(motion: MotionGrid, shape: Shape) -> list[Array]:
    """`q' = v - q / tau` from rest, by the increments of the position; and what an earlier stroke left,
    exp(-t/tau).
    """
    from scipy.signal import lfilter  # noqa: PLC0415 - a daemon starts without it

    q = np.empty_like(motion.x)
    for piece in motion.pieces:
        x = motion.x[piece]
        dt = float(motion.t[piece][1] - motion.t[piece][0])
        decay = np.exp(-dt / shape[0])
        gain = shape[0] / dt * (1.0 - decay)
        q[piece] = lfilter([gain], [1.0, -decay], np.diff(x, prepend=x[:1]))
    first = np.zeros_like(q)
    first[motion.pieces[0]] = np.exp(-motion.t[motion.pieces[0]] / shape[0])
    return [q, first]


def _branches(motion: MotionGrid, shape: Shape) -> list[Array]:
    return _branch(motion, shape[:1]) + _branch(motion, shape[1:])


def _times(extent: Extent) -> list[Shape]:
    return log_grid(2.0 / extent.cutoff_hz, 0.25 * extent.duration_s, 10)


def _pairs(extent: Extent) -> list[Shape]:
    return two(log_grid(2.0 / extent.cutoff_hz, 0.25 * extent.duration_s, 6))


def _both(found: Found) -> Values:
    c, s = found.coefficients, found.shape
    return {
        "stiffness_n_m": c[0], "time_constant_s": s[0],
        "second_stiffness_n_m": c[2], "second_time_constant_s": s[1],
    }  # fmt: skip


def _each(found: Found) -> list[Entry]:
    return [
        entry(StressRelaxation, {"stiffness_n_m": k, "time_constant_s": tau})
        for k, tau in zip(found.coefficients[::2], found.shape, strict=True)
    ]


class StressRelaxation(ForceEffect):
    """One Maxwell branch `df/dt = k v - f / tau`, k = stiffness_n_m, tau = time_constant_s.

    Its elongation q = f / k obeys `tau dq/dt = tau v - q`, solved exactly for a velocity constant over dt.
    A model may hold several branches.
    """

    name = "stress_relaxation"
    site = "wall"
    parameters = (
        Parameter("stiffness_n_m", "N/m", 1.0, 0.0, 1e9),
        Parameter("time_constant_s", "s", 1.0, 1e-4, 1e4, linear=False),
    )
    reference = "Fung, Biomechanics: Mechanical Properties of Living Tissues, 2nd ed., chapter 2"
    fingerprint = (
        "an exponential fading during each hold, of opposite sign after a withdrawal; "
        "the loop is widest at one speed"
    )
    words = "a force that fades while the instrument is held"
    equation = ("{stiffness_n_m} z; z' = x' - z/{time_constant_s}",)
    candidates = (
        ForceColumns(
            coefficients=("stiffness_n_m",), shapes=("time_constant_s",), signs=(1, 0), columns=_branch,
            grid=_times, at_wall=True,
        ),
        ForceColumns(
            form="two", signs=(1, 0, 1, 0), columns=_branches, grid=_pairs, at_wall=True, naming=_both,
            sizes=("stiffness_n_m",), making=_each,
        ),
    )  # fmt: skip

    def _configure(self) -> None:
        self._tau = self.values["time_constant_s"]

    def reset(self) -> None:
        """The branch is relaxed."""
        self._elongation = FirstOrderLag(self._tau)

    def regressors(self, t: float, x: float, v: float, a: float, dt: float) -> tuple[float, ...]:
        """(elongation of the branch's spring in m,)."""
        return (self._elongation.advance(self._tau * v, dt),)

    def _columns(self, t: Array, x: Array, v: Array, a: Array, dt: Array) -> Array:
        return lagged(self._tau * v, dt, self._tau)[:, None]
