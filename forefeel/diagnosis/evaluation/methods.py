"""The predictors that are compared, all behind one port. None is told the delay: it sees what arrives."""

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from math import inf
from operator import mul
from typing import Generic, NamedTuple, Protocol, TypeVar

from forefeel.common.causes.model import ContactModel
from forefeel.common.estimation.identification import (
    ContactEstimate,
    ContactIdentifier,
    IdentificationSettings,
    linear_model,
)
from forefeel.common.estimation.paper import PaperRls
from forefeel.common.estimation.prediction import ContactPredictor
from forefeel.common.estimation.predictor import Predictor

PAPER_LAMBDA = 0.96  # forgetting factor of a sample; one of the 0.95 to 0.99 that the paper recommends
LONGEST_LATENESS_S = 60.0
"""A force that is later than this meets no motion: that of its stamp is forgotten."""

# Hz, cutoff of the velocity's filter; the default of the master's `prediction.velocity_cutoff_hz`
_VELOCITY_CUTOFF_HZ = 40.0
_ESTIMATE_EVERY_S = 0.05  # s between two estimates: 20 a second, as the master publishes its parameters
# s in which the stroke is measured
_STROKE_S = 1.0
_AMPLITUDE_M = 1e-6, 1e3  # beyond it the default is kept
_IDENTIFICATION = IdentificationSettings(memory_s=2.0, cutoff_hz=15.0, bounded=False)


class MethodEstimate(NamedTuple):
    """The force now in N; its 95 % band where the method has one; the name of the expert that led."""

    force_n: float
    low_n: float | None = None
    high_n: float | None = None
    leading: str | None = None


class Method(Protocol):
    """Force at the operator's present motion, from late forces.

    Attributes:
        name: as in the table of results.
    """

    name: str

    def move(self, t_s: float, position_m: float) -> None:
        """The own motion at stamp `t_s`, known at once; stamps increase."""
        ...

    def observe(self, stamp_s: float, force_n: float) -> None:
        """A force that has arrived and was measured at `stamp_s`, the stamp of an earlier, or of the next,
        `move`. Calls are in the order of arrival, which need not be that of the stamps.
        """
        ...

    def predict(self) -> MethodEstimate | None:
        """The force at the stamp of the newest `move`; None while there is nothing to say."""
        ...

    def restart(self) -> None:
        """The next `move` follows a gap: no derivative or filter may reach across."""
        ...


T = TypeVar("T")


@dataclass(slots=True)
class Pairs(Generic[T]):
    """Brings late forces and what was known of the motion at their stamps together."""

    _known: dict[float, T] = field(default_factory=dict)
    _stamps: deque[float] = field(default_factory=deque)
    _late: list[tuple[float, float]] = field(default_factory=list)

    def remember(self, t_s: float, value: T) -> None:
        """What is to be paired with the force of stamp `t_s`."""
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

    name = "zoh"

    def __init__(self) -> None:
        self._stamp_s = -inf
        self._force_n: float | None = None

    def move(self, t_s: float, position_m: float) -> None: ...

    def observe(self, stamp_s: float, force_n: float) -> None:
        if stamp_s > self._stamp_s:
            self._stamp_s, self._force_n = stamp_s, force_n

    def predict(self) -> MethodEstimate | None:
        return None if self._force_n is None else MethodEstimate(self._force_n)

    def restart(self) -> None: ...


class PaperMethod:
    """The paper's recursive least squares, lambda = 0.96 per sample, on x'', x', x by causal differences.

    Two things are not the paper's, and both favour it: P is symmetrised, and a force is paired with the
    motion of its own stamp.
    """

    name = "paper"

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
        """Differentiates, then learns from what arrived."""
        self._phi = self._differences(t_s, position_m)
        if self._phi is not None:
            self._pairs.remember(t_s, self._phi)
        for _, phi, force_n in self._pairs.take():
            self._rls.update(phi, force_n)
            self._theta = None

    def _differences(self, t_s: float, x: float) -> tuple[float, float, float] | None:
        """(x'', x', x), or None at the first two samples."""
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

    def predict(self) -> MethodEstimate | None:
        """phi(t) theta; infinity or NaN once the recursion has overflowed."""
        if self._phi is None:
            return None
        if self._theta is None:
            self._theta = self._rls.theta.tolist()
        return MethodEstimate(sum(map(mul, self._phi, self._theta)))


class ContactMethod:
    """The safe recursive least squares of `forefeel.common.estimation` on one contact model, memory 2 s.

    The scales of its regressors need a typical stroke: half the range of the own motion in the first second,
    whose forces wait until then.

    Raises:
        ValueError: a model without linear parameters.
    """

    def __init__(self, name: str, model: ContactModel) -> None:
        self.name = name
        self._model = model
        self._settings = _IDENTIFICATION
        self._identifier = ContactIdentifier(model, self._settings)
        self._predictor = ContactPredictor(model, _VELOCITY_CUTOFF_HZ)
        self._pairs = Pairs[float]()
        self._first: list[tuple[float, float]] | None = []
        self._estimate: ContactEstimate | None = None
        self._estimated_s = -inf
        self._force_n: float | None = None
        self.restart()

    def restart(self) -> None:
        """The filters of the own motion start anew; the identifier sees the gap by itself."""
        self._last: tuple[float, float] | None = None
        self._predictor.reset()

    def move(self, t_s: float, position_m: float) -> None:
        """Learns from what arrived, then predicts."""
        self._pairs.remember(t_s, position_m)
        if self._first is not None:
            self._measure_stroke(self._first, t_s, position_m)
        if self._first is None:
            self._learn(t_s)
        v = 0.0
        if self._last is not None:
            v = (position_m - self._last[1]) / (t_s - self._last[0])
        self._last = t_s, position_m
        self._force_n = self._predictor.predict(_ns(t_s), position_m, v, self._estimate)

    def _measure_stroke(self, first: list[tuple[float, float]], t_s: float, position_m: float) -> None:
        """At the end of the first second the identifier is made anew, for the stroke seen in it."""
        first.append((t_s, position_m))
        if t_s - first[0][0] < _STROKE_S:
            return
        positions_m = [x for _, x in first]
        amplitude_m = 0.5 * (max(positions_m) - min(positions_m))
        if _AMPLITUDE_M[0] <= amplitude_m <= _AMPLITUDE_M[1]:
            settings = replace(self._settings, nominal_amplitude_m=amplitude_m)
            self._identifier = ContactIdentifier(self._model, settings)
        self._first = None

    def _learn(self, t_s: float) -> None:
        for stamp_s, x, force_n in self._pairs.take():
            self._identifier.observe(_ns(stamp_s), x, force_n)
        if t_s - self._estimated_s >= _ESTIMATE_EVERY_S:
            self._estimate, self._estimated_s = self._identifier.estimate(), t_s

    def observe(self, stamp_s: float, force_n: float) -> None:
        self._pairs.arrived(stamp_s, force_n)

    def predict(self) -> MethodEstimate | None:
        """The model's force, once its estimate is valid."""
        return None if self._force_n is None else MethodEstimate(self._force_n, leading="model")


def _ns(t_s: float) -> int:
    return round(t_s * 1e9)


class Forefeel:
    """The predictor that runs in the master; the model of a model.yaml takes part as it was loaded."""

    name = "forefeel"

    def __init__(self, model: ContactModel | None) -> None:
        self._predictor = Predictor(model)

    def move(self, t_s: float, position_m: float) -> None:
        self._predictor.move(t_s, position_m)

    def observe(self, stamp_s: float, force_n: float) -> None:
        self._predictor.observe(stamp_s, force_n)

    def predict(self) -> MethodEstimate | None:
        """The force with its band."""
        said = self._predictor.predict()
        return None if said is None else MethodEstimate(*said)

    def restart(self) -> None:
        self._predictor.restart()


METHODS: Mapping[str, Callable[[ContactModel | None], Method]] = {
    "zoh": lambda model: ZeroOrderHold(),
    "paper": lambda model: PaperMethod(),
    "mbk_bias": lambda model: ContactMethod("mbk_bias", linear_model()),
    "forefeel": Forefeel,
}
"""By name: makes one that knows nothing yet. The model of a model.yaml is for forefeel alone."""
