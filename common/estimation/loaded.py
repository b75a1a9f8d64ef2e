"""The contact model of a file on the own motion of now, and what only this run can tell of it.

    f = S(f0(x, v, a)) + theta' psi,   psi = (1, x, v, a, columns of time)

with f0 the lasting effects at their loaded parameters and S the sensor's lags and delays (`transfer`). theta
is least squares over late forces with a ridge of rho_j seconds of each column's own usual size, as in
`experts`: little for what the file can not know, the bias and the columns of time, more for m, b
and k, which it does. Time counts by the stamps of the commands, and a force is paired with the command that
it answers: the delay and the two clocks stay out of it.

The velocity is the given one through a `StateFilter`, led by the filter's own lag, 2 / (2 pi cutoff_hz): a
friction that turns 8 ms late at every reversal loses a third of what it is worth. The acceleration is the
filtered one, so that the inertia term renders no encoder steps.
"""

from math import exp, inf, isfinite, nan, pi
from operator import mul
from typing import NamedTuple

import numpy as np

from forefeel.common.causes.model import ContactModel
from forefeel.common.estimation.identification import ContactEstimate
from forefeel.common.estimation.state_filter import GAP_S, StateFilter
from forefeel.common.estimation.transfer import SensorColumns, SensorModel, lasting
from forefeel.common.slots import CommandRing

_EVERY_S = 0.004  # s, least time between two forces that are learned
_SOLVE_EVERY_S = 0.05  # s between two solutions
_MEMORY_S = 20.0  # s, time constant of forgetting
# A ridge of rho s of a column's usual size keeps theta near zero. The file knows m, b and k, but no
# bias and no phase.
_RHO_BIAS_S = 0.002  # s, rho of the bias
_RHO_TAUGHT_S = 2.0  # s, rho of x, v and a
_RHO_TIME_S = 0.01  # s, rho of the columns of time
_MOTION_COLUMNS = 4  # columns of psi before those of time: 1, x, v, a
_LONG_AGO_NS = -(10**18)  # ns, 32 years before zero: the first force is never too early
_TINY = 1e-200  # keeps the equations solvable where a column has been zero throughout


class Forces(NamedTuple):
    """The force now in N by the model as it has been identified, and as it was loaded; NaN: not known."""

    identified_n: float
    loaded_n: float


NOTHING = Forces(nan, nan)


class _Said(NamedTuple):
    """What the loaded model said of a command: S(f0) in N, psi."""

    force_n: float
    psi: tuple[float, ...]


class LoadedContact:
    """One contact model on the own motion. `move` and `reset` run in the haptic loop, `learn` beside it: what
    they share is replaced as a whole.

    Args:
        model: as it was loaded.
        cutoff_hz: of the velocity's filter.
    """

    def __init__(self, model: ContactModel, cutoff_hz: float) -> None:
        self._columns, self._sensor = SensorColumns(model), SensorModel(model)
        self._runtime = lasting(model).runtime()
        self._velocity = StateFilter(cutoff_hz)
        self._lead_s = 2.0 / (2.0 * pi * cutoff_hz)
        self._correction = _Correction(_MOTION_COLUMNS + len(self._columns))
        self._said = CommandRing[_Said]()
        self._origin_ns: int | None = None
        self._learned_ns = _LONG_AGO_NS
        self.reset()

    def reset(self) -> None:
        """The motion so far is over, as after a new grip; what was learned stays."""
        self._runtime.reset()
        self._sense_loaded, self._sense_identified = self._sensor.lines(2)
        self._velocity.reset()
        self._last_ns: int | None = None

    def move(
        self, stamp_ns: int, position_m: float, velocity_m_s: float, estimate: ContactEstimate | None
    ) -> Forces:
        """The forces at a command; NaN at the first one, after a pause over 0.1 s, where the stamp does not
        increase or the motion is not finite.

        Raises:
            ValueError: the estimate is one of another model.
        """
        if not (isfinite(position_m) and isfinite(velocity_m_s)):
            return NOTHING
        dt = inf if self._last_ns is None else (stamp_ns - self._last_ns) * 1e-9
        if dt <= 0.0:
            return NOTHING
        if dt > GAP_S:
            self.reset()
            self._velocity.step(velocity_m_s, 0.0)
        self._last_ns = stamp_ns
        if self._origin_ns is None:
            self._origin_ns = stamp_ns
        if dt > GAP_S:
            return NOTHING
        v, a, _ = self._velocity.step(velocity_m_s, dt)
        return self._forces(stamp_ns, (position_m, v + self._lead_s * a, a), dt, estimate)

    def _forces(
        self, stamp_ns: int, motion: tuple[float, float, float], dt: float, estimate: ContactEstimate | None
    ) -> Forces:
        t = (stamp_ns - (self._origin_ns or 0)) * 1e-9
        phi = self._runtime.regressors(t, *motion, dt)
        psi, theta = (1.0, *motion, *self._columns.at(t)), self._correction.theta
        force_n = self._sense_loaded(t, sum(map(mul, phi, self._runtime.linear_values)), dt)
        self._said.put(stamp_ns, _Said(force_n, psi))
        loaded_n = self._sensor.limited(force_n + sum(map(mul, psi, theta)))
        if estimate is None or not estimate.valid:
            return Forces(nan, loaded_n)
        if estimate.names != self._runtime.linear_names:
            raise ValueError(f"estimate of {estimate.names}: expected {self._runtime.linear_names}")
        identified_n = self._sense_identified(t, sum(map(mul, phi, estimate.values)), dt)
        return Forces(self._sensor.limited(identified_n + _of_time_n(psi, theta)), loaded_n)

    def learn(self, stamp_ns: int, force_n: float) -> None:
        """A late force in N that answers the command of that stamp; at most one per 4 ms counts."""
        said = self._said.get(stamp_ns)
        dt = (stamp_ns - self._learned_ns) * 1e-9
        if said is None or dt < _EVERY_S:
            return
        if isfinite(force_n) and not self._sensor.at_limit(force_n):
            self._learned_ns = stamp_ns
            self._correction.learn(said.psi, force_n - said.force_n, min(dt, GAP_S))

    def of_motion_n(self, stamp_ns: int, force_n: float) -> float:
        """The force in N less what is a matter of time, of the command of that stamp."""
        said = self._said.get(stamp_ns)
        if said is None:
            return force_n
        return force_n - _of_time_n(said.psi, self._correction.theta)


def _of_time_n(psi: tuple[float, ...], theta: tuple[float, ...]) -> float:
    """The part of the columns of time."""
    force_n: float = sum(map(mul, psi[_MOTION_COLUMNS:], theta[_MOTION_COLUMNS:]))
    return force_n


class _Correction:
    """theta: what the forces of this run add to the loaded model.

    Attributes:
        theta: newest solution.
    """

    def __init__(self, n: int) -> None:
        self.theta: tuple[float, ...] = (0.0,) * n
        self._rho_s = np.full(n, _RHO_TIME_S)
        self._rho_s[0], self._rho_s[1:_MOTION_COLUMNS] = _RHO_BIAS_S, _RHO_TAUGHT_S
        self._information, self._moments = np.zeros((n, n)), np.zeros(n)
        self._weight_s = self._unsolved_s = 0.0

    def learn(self, psi: tuple[float, ...], left_n: float, w: float) -> None:
        """What the loaded model left of a force, in N, w seconds after the one before."""
        keep, column = exp(-w / _MEMORY_S), np.array(psi)
        self._information = keep * self._information + w * np.outer(column, column)
        self._moments = keep * self._moments + w * left_n * column
        self._weight_s = keep * self._weight_s + w
        self._unsolved_s += w
        if self._unsolved_s >= _SOLVE_EVERY_S:
            self._unsolved_s = 0.0
            ridge = self._rho_s * np.diagonal(self._information) / self._weight_s + _TINY
            theta = np.linalg.solve(self._information + np.diag(ridge), self._moments)
            self.theta = tuple(theta.tolist())
