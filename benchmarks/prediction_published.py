"""Published predictors that are given more than a master has, for `benchmarks.prediction`.

They are flattered: the best of several in hindsight counts, contacts are known beforehand, a network has seen
the recordings of all other instruments. What is taken of each publication, and what is not, stands beside it.
"""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from itertools import product
from math import exp, inf, log
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.prediction_peers import Autoregression, Incremental, Regression, Ridge
from forefeel.common.estimation.evaluator import Estimate
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.evaluation.arrivals import DelayedLink
from forefeel.diagnosis.evaluation.evaluate import Prepared, prepare
from forefeel.diagnosis.evaluation.methods import Method, Pairs, PaperRls, replay

Array = NDArray[np.float64]

_VELOCITY_S = 0.02  # s over which a velocity is a difference
_FORGETTING = 0.95, 0.98, 0.99, 0.995, 0.999
_LEAST = 0.01  # of the force's range, what a logarithm is taken of; of the time, what is enough of air
_TARES = 0.0, 0.01
_PLACES = 21  # positions at which a contact may begin
_LARGEST_LOG = 50.0  # beyond it a force has diverged anyway
_STEPS = 0.02, 0.1, 0.5  # eta of the projection
_INSTRUMENTS = "emps", "seal", "silverbox"  # of which there are several recordings
_UNITS = 64, 64  # of the network's hidden layers
_PENALTIES = 1e-4, 0.1, 1.0  # on its weights
_LESSONS = 1000  # of each recording
_FAR = 5.0  # times a range, where a regressor of the network ends


def instrument(recording: str) -> str:
    """The bench that a recording was made on, by the beginning of its name; else the recording alone."""
    return next((begin for begin in _INSTRUMENTS if recording.startswith(begin)), recording)


# --- contacts ---


@dataclass(frozen=True, slots=True)
class Contact:
    """Where a contact begins, and on which side: depth = side (x - position_m) > 0, in strokes; there the
    force less `force_n` has the sign `sense`, and tells something from `least_n` on.
    """

    position_m: float
    force_n: float
    side: float
    sense: float
    stroke_m: float
    least_n: float


def contact_in_hindsight(prepared: Prepared, tare: float | None) -> Contact:
    """The contact, of 21 places to begin at on each side, with which batch least squares of the model fit the
    whole recording best. The first place on a side is a contact that never ends.

    Args:
        tare: None: Kelvin-Voigt, the force where it begins is fitted, too. Else Hunt-Crossley, the force is
            this quantile, from the side of the air; 0: the median in the air, if there is some.
    """
    x, t, force_n = prepared.recording.position_m, prepared.recording.time_s, prepared.force_n
    stroke_m = float(np.ptp(x)) or 1.0
    least_n = _LEAST * float(np.ptp(force_n))
    v, least, best = np.gradient(x, t) / stroke_m, inf, Contact(0.0, 0.0, 1.0, 1.0, stroke_m, least_n)
    for share, side, sense in product(np.arange(_PLACES) / _PLACES, (1.0, -1.0), (1.0, -1.0)):
        begin_m = float(x.min() if side > 0 else x.max()) + side * share * stroke_m
        depth = np.maximum(side * (x - begin_m) / stroke_m, 0.0)
        touching, begin_n = depth > 0.0, 0.0
        if tare is not None:
            in_air = not tare and np.mean(~touching) > _LEAST
            outer = tare if sense > 0.0 else 1.0 - tare
            begin_n = float(np.median(force_n[~touching]) if in_air else np.quantile(force_n, outer))
            pressed_n = sense * (force_n - begin_n)
            learned = touching & (pressed_n > least_n)
            if np.count_nonzero(learned) < 10:
                continue
            rows = np.column_stack([np.ones_like(x), np.log(np.maximum(depth, 1e-9)), side * v])
            theta = np.linalg.lstsq(rows[learned], np.log(pressed_n[learned]), rcond=None)[0]
            made_n = begin_n + touching * sense * np.exp(np.minimum(rows @ theta, _LARGEST_LOG))
        else:
            rows = np.column_stack([np.ones_like(x), depth, touching * side * v])
            theta = np.linalg.lstsq(rows, force_n, rcond=None)[0]
            made_n, begin_n = rows @ theta, float(theta[0])
        error = float(np.mean((made_n - force_n) ** 2))
        if error < least:
            least, best = error, Contact(begin_m, begin_n, side, sense, stroke_m, least_n)
    return best


class ContactEwrls:
    """Exponentially weighted recursive least squares of a contact, of depth d:

        Kelvin-Voigt     f = K d + B d'
        Hunt-Crossley    f = K d^n + L d^n d',  linear as  ln f = ln K + n ln d + (L / K) d'

    Batty, Ehrampoosh, Shirinzadeh, Zhong and Smith, Sensors 22 (2022), 9770. Not theirs: the contact is known
    in hindsight, and the forgetting factor is the best of five (the tare of a logarithm, of two). It learns
    in contact only; in the air the force is that of the beginning. d' is a difference over 20 ms.
    """

    def __init__(self, contact: Contact, forgetting: float, logarithmic: bool) -> None:
        self._contact, self._logarithmic = contact, logarithmic
        self._rls = PaperRls(3 if logarithmic else 2, forgetting, symmetrise=True)
        self._pairs = Pairs[list[float]]()
        self._phi: list[float] = []
        self._learned = False
        self.restart()

    def restart(self) -> None:
        self._motion: deque[tuple[float, float]] = deque()

    def observe(self, stamp_s: float, force_n: float) -> None:
        self._pairs.arrived(stamp_s, force_n)

    def move(self, t_s: float, position_m: float) -> None:
        """Learns from the forces that have arrived and were measured in contact."""
        of = self._contact
        depth = of.side * (position_m - of.position_m) / of.stroke_m
        self._motion.append((t_s, depth))
        while len(self._motion) > 2 and self._motion[1][0] <= t_s - _VELOCITY_S:
            self._motion.popleft()
        then_s, then = self._motion[0]
        speed = (depth - then) / (t_s - then_s) if t_s > then_s else 0.0
        self._phi = []
        if depth > 0.0:
            self._phi = [1.0, log(depth), speed] if self._logarithmic else [depth, speed]
        self._pairs.remember(t_s, self._phi)
        for _, phi, force_n in self._pairs.take():
            pressed_n = of.sense * (force_n - of.force_n)
            if phi and (pressed_n > of.least_n or not self._logarithmic):
                self._rls.update(phi, log(pressed_n) if self._logarithmic else pressed_n)
                self._learned = True

    def predict(self) -> Estimate | None:
        if not self._learned:
            return None
        pressed = 0.0
        if self._phi:
            pressed = float(self._rls.theta @ self._phi)
            if self._logarithmic:
                pressed = exp(pressed) if pressed < _LARGEST_LOG else inf
        return Estimate(self._contact.force_n + self._contact.sense * pressed)


# --- a forecast without a model ---


class DynamicLinearisation(Incremental):
    """Compact-form dynamic linearisation, f(t) = f(s) + phi u, with the pseudo-derivative by projection:

        phi += eta u / (mu + u^2) (f(t) - f(s) - phi u)

    Narayan and Fey, PLoS ONE 15 (2020), e0230009, from the control of Hou and Jin. Taken is this form and its
    estimator. Not theirs: a step is as long as the delay, and mu is the mean square of u so far. u is what
    the force changed in the last step (a forecast that knows the sensor alone), or what the own motion
    changes from s to t; eta is one of three; the best of the six in hindsight counts.
    """

    def __init__(self, step: float, by_motion: bool) -> None:
        self._step, self._by_motion = step, by_motion
        self._phi = self._square = 0.0
        self._seen = 0
        super().__init__(self)

    def fit(self, rows: Array, targets: Array) -> None: ...

    def __call__(self, row: Array) -> float:
        return self._phi * float(row[0])

    def _learn(self, t_s: float) -> None:
        for _, (row, held_n), force_n in self._pairs.take():
            u = float(row[0])
            self._seen += 1
            self._square += (u * u - self._square) / self._seen
            if self._square > 0.0:
                error_n = force_n - held_n - self._phi * u
                self._phi += self._step * u / (self._square + u * u) * error_n
                self._fitted = True

    def regressors(self, t_s: float, s: float) -> list[float]:
        return [self.change(self._x, t_s, t_s - s) if self._by_motion else self.change(self._f, s, t_s - s)]


# --- a network trained offline ---

_MIRRORS = tuple(
    np.array([x] * 2 + [f] * 6 + [x] * 12 + [x, f, x, x]) for x in (1.0, -1.0) for f in (1.0, -1.0)
)
"""Signs of the network's regressors where position, or force, counts the other way."""


class NetworkMethod(Autoregression):
    """f(t) = f(s) + range g(phi), g a network that has learned before and learns no more. phi are the
    regressors of `Autoregression`, position, force and velocities, by the range of position or force so far.
    """

    def __init__(self, network: Regression | None) -> None:
        self._low, self._high = np.full(2, inf), np.full(2, -inf)
        super().__init__(network or Ridge())
        self._fitted = network is not None

    def _learn(self, t_s: float) -> None:
        for _, (row, held_n), force_n in self._pairs.take():
            self._rows.append(row)
            self._targets_n.append(force_n - held_n)

    def regressors(self, t_s: float, s: float) -> list[float]:
        """phi, and last the range of the force in N."""
        now = np.array([self._x.at(t_s)[1], self._f.at(s)[1]])
        self._low, self._high = np.minimum(self._low, now), np.maximum(self._high, now)
        x, f = (self._high - self._low + 1e-9).tolist()
        place = (2.0 * now - self._low - self._high) / (x, f)
        changes = np.array(super().regressors(t_s, s)[1:]) / ([x] * 2 + [f] * 6 + [x] * 12)
        phi = [*changes, *place, self.velocity(t_s) / x, self.velocity(s) / x]
        return [*np.clip(phi, -_FAR, _FAR).tolist(), f]

    def lessons(self) -> tuple[Array, Array]:
        """(rows, changes of the force in N), evenly spaced over the last minute."""
        step = max(1, len(self._rows) // _LESSONS)
        return np.array(self._rows)[::step], np.array(self._targets_n)[::step]


class Network:
    """scikit-learn's MLPRegressor on the lessons and their mirror images; its `predict` checks the input for
    longer than the sum takes, so here is the sum.
    """

    def __init__(self, penalty: float) -> None:
        package: Any = import_module("sklearn.neural_network")
        self._regressor = package.MLPRegressor(
            hidden_layer_sizes=_UNITS, alpha=penalty, early_stopping=True, n_iter_no_change=5, random_state=1
        )

    def fit(self, rows: Array, targets: Array) -> None:
        phi, change = rows[:, :-1], np.clip(targets / rows[:, -1], -1.0, 1.0)
        mirrored = np.concatenate([phi * signs for signs in _MIRRORS])
        self._regressor.fit(mirrored, np.concatenate([change * signs[2] for signs in _MIRRORS]))

    def __call__(self, row: Array) -> float:
        *layers, (weights, bias) = zip(self._regressor.coefs_, self._regressor.intercepts_, strict=True)
        values = row[:-1]
        for hidden, shift in layers:
            values = np.maximum(values @ hidden + shift, 0.0)
        return float(row[-1] * (values @ weights + bias)[0])


class OfflineNetworks:
    """Networks that are trained on the recordings of all instruments but one, over the delay of its test."""

    def __init__(self, recordings: Mapping[str, Recording]) -> None:
        self._recordings = {name: each for name, each in recordings.items() if each.force_n is not None}
        self._lessons: dict[tuple[str, float], tuple[Array, Array]] = {}
        self._networks: dict[tuple[str, float], list[Network]] = {}

    def without(self, name: str, delay_s: float) -> list[Network]:
        """One for each penalty, none of which has seen the instrument of this recording."""
        key = instrument(name), delay_s
        if key not in self._networks:
            others = [other for other in self._recordings if instrument(other) != key[0]]
            lessons = [self._taught(other, delay_s) for other in others]
            rows, targets = (np.concatenate(each) for each in zip(*lessons, strict=True))
            self._networks[key] = [Network(penalty) for penalty in _PENALTIES]
            for network in self._networks[key]:
                network.fit(rows, targets)
        return self._networks[key]

    def _taught(self, name: str, delay_s: float) -> tuple[Array, Array]:
        if (name, delay_s) not in self._lessons:
            prepared, method = prepare(self._recordings[name], DelayedLink(delay_s)), NetworkMethod(None)
            replay(prepared.recording, prepared.arrivals, method)
            self._lessons[name, delay_s] = method.lessons()
        return self._lessons[name, delay_s]


# --- what is compared ---

Candidates = Callable[[str, Prepared, OfflineNetworks], Sequence[Method]]


def _ewrls(logarithmic: bool) -> Candidates:
    def candidates(_name: str, prepared: Prepared, _networks: OfflineNetworks) -> Sequence[Method]:
        contacts = [contact_in_hindsight(prepared, tare) for tare in (_TARES if logarithmic else (None,))]
        return [ContactEwrls(of, forgetting, logarithmic) for of in contacts for forgetting in _FORGETTING]

    return candidates


PUBLISHED: Mapping[str, tuple[str, Candidates]] = {
    "kv_ewrls": ("numpy", _ewrls(logarithmic=False)),
    "hc_ewrls": ("numpy", _ewrls(logarithmic=True)),
    "model_free": (
        "numpy",
        lambda _name, _prepared, _networks: [
            DynamicLinearisation(step, by_motion) for step in _STEPS for by_motion in (False, True)
        ],
    ),
    "offline_network": (
        "sklearn",
        lambda name, prepared, networks: [
            NetworkMethod(network) for network in networks.without(name, prepared.delay_s)
        ],
    ),
}
"""The package that each needs, and what makes those of which the best in hindsight counts."""
