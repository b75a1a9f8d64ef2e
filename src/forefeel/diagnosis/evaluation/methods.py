"""The predictors that are compared, all behind one port, and a recording as they meet it. None is told the
delay: it sees what arrives.
"""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf, pi
from operator import mul
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from forefeel.common.causes.model import ContactModel
from forefeel.common.estimation.evaluator import Estimate
from forefeel.common.estimation.predictor import Predictor
from forefeel.common.estimation.state_filter import GAP_S, StateFilter
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.evaluation.arrivals import Arrivals
from forefeel.diagnosis.evaluation.rls import RecursiveLeastSquares

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

PAPER_LAMBDA = 0.96  # forgetting factor of a sample; one of the 0.95 to 0.99 that the paper recommends
LONGEST_LATENESS_S = 60.0
"""A force that is later than this meets no motion: that of its stamp is forgotten."""

_CUTOFF_HZ = 15.0  # of the filters that motion and force pass before mbk_bias learns from them
_SETTLING_S = 2.0 / _CUTOFF_HZ  # then a restarted filter is within 0.5 % of its course
# Hz, of the own velocity: a lag of 8 ms, below the 15 ms at which a delayed damper is felt
_VELOCITY_CUTOFF_HZ = 40.0
_MEMORY_S = 2.0
_FEWEST_UPDATES = 200  # before mbk_bias says anything
_STROKE_S = 1.0  # s in which the stroke is measured
_LEAST_M, _USUAL_M = 1e-6, 5e-3  # amplitude below which that second was rest, and what is taken then


class Method(Protocol):
    """Force at the operator's present motion, from late forces."""

    def move(self, t_s: float, position_m: float) -> None:
        """The own motion at stamp `t_s`, known at once; stamps increase."""
        ...

    def observe(self, stamp_s: float, force_n: float) -> None:
        """A force that has arrived and was measured at `stamp_s`, the stamp of an earlier, or of the next,
        `move`. Calls are in the order of arrival, which need not be that of the stamps.
        """
        ...

    def predict(self) -> Estimate | None:
        """The force at the stamp of the newest `move`; None while there is nothing to say."""
        ...

    def restart(self) -> None:
        """The next `move` follows a gap: no derivative or filter may reach across."""
        ...


T = TypeVar("T")


@dataclass(slots=True)
class Pairs(Generic[T]):
    """Pairs late forces with what was remembered of the motion at their stamps."""

    _known: dict[float, T] = field(default_factory=dict)
    _stamps: deque[float] = field(default_factory=deque)
    _late: list[tuple[float, float]] = field(default_factory=list)

    def remember(self, t_s: float, value: T) -> None:
        """Stores what is to be paired with the force of stamp `t_s`; drops what is older than 60 s."""
        self._known[t_s] = value
        self._stamps.append(t_s)
        while self._stamps[0] < t_s - LONGEST_LATENESS_S:
            del self._known[self._stamps.popleft()]

    def arrived(self, stamp_s: float, force_n: float) -> None:
        self._late.append((stamp_s, force_n))

    def take(self) -> list[tuple[float, T, float]]:
        """(stamp, value, force) of the forces that arrived since the last call, by stamp.

        Those whose motion is not known are dropped.
        """
        late, self._late = sorted(self._late), []
        known = self._known
        return [(stamp_s, known[stamp_s], force_n) for stamp_s, force_n in late if stamp_s in known]


class ZeroOrderHold:
    """The newest force by stamp among those that arrived."""

    def __init__(self) -> None:
        self._stamp_s = -inf
        self._force_n: float | None = None

    def move(self, t_s: float, position_m: float) -> None: ...

    def observe(self, stamp_s: float, force_n: float) -> None:
        if stamp_s > self._stamp_s:
            self._stamp_s, self._force_n = stamp_s, force_n

    def predict(self) -> Estimate | None:
        return None if self._force_n is None else Estimate(self._force_n)

    def restart(self) -> None: ...


class PaperRls:
    """The paper's own recursive least squares, equations (8) to (12), as they stand there: it has none of the
    safeguards of `forefeel.diagnosis.evaluation.rls`.

    Reference: "Study on Contact Force Prediction for the Vascular Interventional Surgical Robot based on
    Parameter Identification".

    Args:
        n: number of parameters.
        lam: forgetting factor lambda; 1 is ordinary recursive least squares, the paper recommends 0.95-0.99.
        delta: P(0) = I / delta (8), "very small".
        symmetrise: replace P by (P + P') / 2 after each update. The paper does not; without it rounding ends
            many long runs early.

    Attributes:
        theta: parameters, shape (n,). covariance: P, shape (n, n).
    """

    def __init__(self, n: int, lam: float, *, delta: float = 1e-6, symmetrise: bool = False) -> None:
        self.theta: Array = np.zeros(n)
        self.covariance: Array = np.eye(n) / delta
        self._lam = lam
        self._symmetrise = symmetrise

    def update(self, phi: Sequence[float] | Array, y: float) -> float:
        """Learns from one sample: updates `theta` and `covariance`, and returns the innovation e(k) (11),
        made with `theta` before. Overflow shows as infinity or NaN in `theta`, not as an exception.
        """
        phi = np.asarray(phi, dtype=np.float64)
        with np.errstate(over="ignore", invalid="ignore"):
            p_phi = self.covariance @ phi
            gain = p_phi / (self._lam + phi @ p_phi)  # (9)
            e = float(y - phi @ self.theta)  # (11)
            self.theta = self.theta + gain * e  # (12)
            p = (self.covariance - np.outer(gain, phi @ self.covariance)) / self._lam  # (10)
            self.covariance = 0.5 * (p + p.T) if self._symmetrise else p
        return e


class PaperMethod:
    """The paper's recursive least squares, lambda = 0.96 per sample, on x'', x', x by causal differences.

    Two things are not the paper's, and both favour it: P is symmetrised, and a force is paired with the
    motion of its own stamp.
    """

    def __init__(self) -> None:
        self._rls = PaperRls(3, PAPER_LAMBDA, symmetrise=True)
        self._theta: list[float] | None = None
        self._pairs = Pairs[tuple[float, float, float]]()
        self.restart()

    def restart(self) -> None:
        self._t_s: float | None = None
        self._x = 0.0
        self._v: float | None = None
        self._phi: tuple[float, float, float] | None = None

    def move(self, t_s: float, position_m: float) -> None:
        """Takes the motion's differences, then learns from each force that has arrived with those of its own
        stamp. At the first two samples after a start or gap there are no differences, so nothing to predict.
        """
        self._phi = self._differences(t_s, position_m)
        if self._phi is not None:
            self._pairs.remember(t_s, self._phi)
        for _, phi, force_n in self._pairs.take():
            self._rls.update(phi, force_n)
            self._theta = None

    def _differences(self, t_s: float, x: float) -> tuple[float, float, float] | None:
        """(x'', x', x) by backward differences, or None at the first two samples since `restart`; keeps
        stamp, position and speed for the next call.
        """
        v = a = None
        if self._t_s is not None:
            dt = t_s - self._t_s
            v = (x - self._x) / dt
            if self._v is not None:
                a = (v - self._v) / dt
        self._t_s, self._x, self._v = t_s, x, v
        return None if v is None or a is None else (a, v, x)

    def observe(self, stamp_s: float, force_n: float) -> None:
        self._pairs.arrived(stamp_s, force_n)

    def predict(self) -> Estimate | None:
        """phi(t) theta; infinity or NaN once the recursion has overflowed."""
        if self._phi is None:
            return None
        if self._theta is None:
            self._theta = self._rls.theta.tolist()
        return Estimate(sum(map(mul, self._phi, self._theta)))


class MbkBias:
    """Equation (1) and the bias that every load cell has, f = m x'' + b x' + k x + f0, by the safe recursive
    least squares of `forefeel.diagnosis.evaluation.rls`. No parameter is bounded: a recording may hold the
    reaction.

    It learns from motion and force of the same stamps behind the same filter, which so biases nothing (see
    `state_filter`). The prediction takes the position as it is, so the elastic force has no lag.

    The scales of its regressors are those of a sinusoid of 0.75 Hz, of half the range that the own motion has
    in the first second; the forces of that second wait until then.
    """

    def __init__(self) -> None:
        self._pairs = Pairs[float]()
        self._first: list[tuple[float, float]] = []
        self._rls: RecursiveLeastSquares | None = None
        self._position, self._force = StateFilter(_CUTOFF_HZ), StateFilter(_CUTOFF_HZ)
        self._learned_s = -inf
        self._settling_s = _SETTLING_S
        self._velocity = StateFilter(_VELOCITY_CUTOFF_HZ)
        self.restart()

    def restart(self) -> None:
        """The filter of the own velocity starts anew; those of the pairs see the gap by themselves."""
        self._last: tuple[float, float] | None = None
        self._phi: tuple[float, float, float, float] | None = None
        self._velocity.reset()

    def move(self, t_s: float, position_m: float) -> None:
        """Learns from the forces that have arrived, but not before 1 s of motion has scaled the estimator;
        then sets the regressors (x'', x', x, 1) of this motion, none at the first sample after a gap.
        """
        self._pairs.remember(t_s, position_m)
        if self._rls is None:
            self._measure_stroke(t_s, position_m)
        if self._rls is not None:
            for stamp_s, x, force_n in self._pairs.take():
                self._learn(self._rls, stamp_s, x, force_n)
        if self._last is None:
            self._velocity.step(0.0, 0.0)
        else:
            dt = t_s - self._last[0]
            v, a, _ = self._velocity.step((position_m - self._last[1]) / dt, dt)
            self._phi = a, v, position_m, 1.0
        self._last = t_s, position_m

    def _measure_stroke(self, t_s: float, position_m: float) -> None:
        """Collects the motion; once it spans 1 s, makes the estimator, its regressors scaled by a sine of
        0.75 Hz of half the range, or of 5 mm if that is below 1 um.
        """
        self._first.append((t_s, position_m))
        if t_s - self._first[0][0] < _STROKE_S:
            return
        positions_m = [x for _, x in self._first]
        stroke_m = 0.5 * (max(positions_m) - min(positions_m))
        stroke_m = stroke_m if stroke_m >= _LEAST_M else _USUAL_M
        w = 2.0 * pi * 0.75
        scales = w * w * stroke_m, w * stroke_m, stroke_m, 1.0
        self._rls = RecursiveLeastSquares(scales, _MEMORY_S)

    def _learn(self, rls: RecursiveLeastSquares, stamp_s: float, position_m: float, force_n: float) -> None:
        """Filters position and force of one stamp and learns from them. Ignores a stamp that is not newer
        than the last. A gap over 0.1 s, as at the start, resets the filters, which settle for 0.13 s before
        it learns.
        """
        dt = stamp_s - self._learned_s
        if dt <= 0.0:
            return
        self._learned_s = stamp_s
        if dt > GAP_S:
            self._position.reset()
            self._force.reset()
            self._settling_s = _SETTLING_S
        x, v, a = self._position.step(position_m, dt)
        y, _, _ = self._force.step(force_n, dt)
        if dt <= GAP_S:
            self._settling_s -= dt
        if self._settling_s <= 0.0:
            rls.update((a, v, x, 1.0), y, dt)

    def observe(self, stamp_s: float, force_n: float) -> None:
        self._pairs.arrived(stamp_s, force_n)

    def predict(self) -> Estimate | None:
        """phi(t)' theta, once 200 samples have told something."""
        if self._phi is None or self._rls is None or self._rls.updates < _FEWEST_UPDATES:
            return None
        return Estimate(sum(map(mul, self._phi, self._rls.theta)))


METHODS: Mapping[str, Callable[[ContactModel | None], Method]] = {
    "zoh": lambda model: ZeroOrderHold(),
    "paper": lambda model: PaperMethod(),
    "mbk_bias": lambda model: MbkBias(),
    "forefeel": Predictor,  # that of the master
}
"""By name: makes one that knows nothing yet. The model of a model.yaml is for forefeel alone."""


@dataclass(frozen=True, slots=True, eq=False)
class MethodTrace:
    """Predictions of a method at each of n stamps.

    Attributes:
        answered: where it predicted. force_n, low_n, high_n: NaN where it did not, or has no band.
        leading: the expert that led, empty where there is none.
    """

    answered: Mask
    force_n: Array
    low_n: Array
    high_n: Array
    leading: tuple[str, ...]


def replay(recording: Recording, arrivals: Arrivals, method: Method) -> MethodTrace:
    """Runs a method over a recording and returns its predictions: at each stamp it is given the forces that
    have arrived since the last, then the own motion, and is asked. Where it gives none the force is NaN.

    After a gap the method is restarted, between the forces that arrived in the gap and the next motion.

    Raises:
        ValueError: the recording has no force.
    """
    if recording.force_n is None:
        raise ValueError(f"{recording.name}: no force")
    time_s, position_m, force_n = (
        column.tolist() for column in (recording.time_s, recording.position_m, recording.force_n)
    )
    starts = {piece.start for piece in recording.segments()[1:]}
    followed = method.columns if isinstance(method, Predictor) else ()
    further = {column.name: column.values.tolist() for column in recording.further if column.name in followed}
    estimates: list[Estimate | None] = []
    for k, batch in enumerate(arrivals.batches()):
        for i in batch:
            method.observe(time_s[i], force_n[i])
        if k in starts:
            method.restart()
        if isinstance(method, Predictor):
            method.move(time_s[k], position_m[k], {name: values[k] for name, values in further.items()})
        else:
            method.move(time_s[k], position_m[k])
        estimates.append(method.predict())
    known = [estimate or Estimate(np.nan) for estimate in estimates]
    columns = np.array([estimate[:3] for estimate in known], dtype=np.float64)
    answered = np.array([estimate is not None for estimate in estimates])
    leading = tuple(estimate.leading for estimate in known)
    return MethodTrace(answered, columns[:, 0], columns[:, 1], columns[:, 2], leading)
