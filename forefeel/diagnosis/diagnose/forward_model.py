"""A fit turned round: the state equation whose input is the force and whose output is the position."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import expm

from forefeel.common.causes.candidate import ReadingColumns, Shape, base_name
from forefeel.common.causes.catalogue import CANDIDATES
from forefeel.common.error_size import Floats
from forefeel.diagnosis.diagnose.regression import ModelFit, RecordingRegression

_SETTLED = 1e-3
_SMOOTH = {
    "stiffening": (0, 1), "hunt_crossley_damping": (2,), "quadratic_drag": (3,), "asymmetric_damping": (4,),
    "stiffness_change": (5,),
}  # fmt: skip
_BRANCHES = "stress_relaxation", "stress_relaxation:two"
_MODE = "unmodelled_resonance"
_FRICTION = (
    "coulomb_friction", "coulomb_friction:asymmetric", "stribeck_friction", "stribeck_friction:exponential",
    "coulomb_friction:elastic", "stribeck_friction:elastic", "position_dependent_friction:elastic",
    "presliding_hysteresis", "presliding_hysteresis:bristles", "presliding_hysteresis:two",
    "position_dependent_friction",
)  # fmt: skip
_KNOWN = frozenset({*_SMOOTH, *_BRANCHES, _MODE, *_FRICTION})


@dataclass(frozen=True, slots=True, eq=False)
class ForwardModel:
    """A model that can be run from the force to the position.

    Attributes:
        names, shapes: how many shape parameters each cause has, in the order of `theta`.
        owners: the cause of each coefficient, "" for mass, damping, stiffness.
        theta: coefficients in SI units of a force that resists, then all shapes.
        band: speed within which a friction's direction is linear, m/s.
    """

    shapes: tuple[tuple[str, int], ...]
    owners: tuple[str, ...]
    theta: Floats
    band: float

    @classmethod
    def of(cls, regression: RecordingRegression, fit: ModelFit) -> "ForwardModel | None":
        """The model of a fit; None when it can not be turned round.

        That is: a mass that is not positive or less than twice its standard error, a stiffness that pushes
        away, or a cause without inverse (a play, a lost contact, a lag or delay of the force, a cause of
        others).
        """
        if any(name not in _KNOWN and not isinstance(CANDIDATES[name], ReadingColumns) for name in fit.model):
            return None
        coefficients = fit.coefficients * regression.sense
        if not coefficients[0] > 2.0 * _mass_error(regression, fit) or coefficients[2] < 0.0:
            return None
        flat = [value for shape in fit.model.values() for value in shape]
        shapes = tuple((name, len(shape)) for name, shape in fit.model.items())
        band = _SETTLED * regression.extent.speed_m_s
        return cls(shapes, fit.owners, np.concatenate([coefficients, flat]), band)

    def with_theta(self, theta: Floats) -> "ForwardModel":
        """Other parameters, same structure."""
        return replace(self, theta=theta)

    def with_offset(self) -> "ForwardModel":
        """With a constant force among its parameters, zero where no bias was found."""
        if "bias" in self.owners:
            return self
        at = len(self.owners)
        theta = np.insert(self.theta, at, 0.0)
        return replace(self, shapes=(*self.shapes, ("bias", 0)), owners=(*self.owners, "bias"), theta=theta)

    @property
    def model(self) -> dict[str, Shape]:
        """Causes and their shapes."""
        found, at = {}, len(self.owners)
        for name, size in self.shapes:
            found[name] = tuple(map(float, self.theta[at : at + size]))
            at += size
        return found

    def coefficients(self, name: str) -> Floats:
        """Of one cause, "" for mass, damping, stiffness."""
        return np.array([c for c, owner in zip(self.theta, self.owners, strict=False) if owner == name])

    def run(
        self, force: Floats, start_s: float, step_s: float, every: int, state: Floats, most: float
    ) -> Floats:
        """Position in m after every `every` steps, inf from where it left +- `most`.

        Args:
            force: N at both ends of every step, shape (steps, 2).
            start_s, step_s: time since the recording's first stamp, length of a step.
            every: steps per sample.
            state: position in m and speed in m/s at the start.
            most: largest position to believe, m.
        """
        from forefeel.diagnosis.diagnose.forward_kernel import run  # noqa: PLC0415 - loads the compiler

        a, b = self._linear()
        if not (np.isfinite(a).all() and self.coefficients("")[0] > 0.0):
            return np.full(len(force) // every + 1, np.inf)
        phi, g0, g1 = first_order_hold(a, b, step_s)
        known = self._of_time(np.asarray(start_s + step_s * np.arange(len(force) + 1), dtype=np.float64))
        u = force - np.column_stack([known[:-1], known[1:]])
        begin = np.concatenate([state, np.zeros(len(b) - 2)])
        grid = np.array([start_s, step_s, float(every), most])
        return np.asarray(run(phi, g0, g1, u, begin, self._smooth(), self._dry(), grid))

    def _linear(self) -> tuple[Floats, Floats]:
        """A and B of `z' = A z + B u`; z = x, v, then elongations of branches, then y, y' of a mode."""
        m, b, k = self.coefficients("")
        model = self.model
        taus = [tau for name in _BRANCHES for tau in model.get(name, ())]
        gains = [c for name in _BRANCHES for c in self.coefficients(name)[::2]]
        size = 2 + len(taus) + (2 if _MODE in model else 0)
        force = np.zeros(size)
        force[:2] = k, b
        force[2 : 2 + len(taus)] = gains
        a, push = np.zeros((size, size)), np.zeros(size)
        a[0, 1] = 1.0
        for i, tau in enumerate(taus):
            a[2 + i, 1], a[2 + i, 2 + i] = 1.0, -1.0 / tau
        if _MODE in model:
            w, zeta = 2.0 * np.pi * model[_MODE][0], model[_MODE][1]
            held, *own = self.coefficients(_MODE)
            rubbed = own[0] if own else 2.0 * zeta * held
            force[-2:] = held * w * w, rubbed * w
        a[1], push[1] = -force / m, 1.0 / m
        if _MODE in model:
            a[-2, -1] = 1.0
            a[-1] = a[1]
            a[-1, -2:] -= w * w, 2.0 * zeta * w
            push[-1] = push[1]
        return a, push

    def _of_time(self, t: Floats) -> Floats:
        """Forces that are known beforehand, in N at the times t."""
        total = np.zeros(len(t))
        for name, shape in self.model.items():
            candidate = CANDIDATES[name]
            if isinstance(candidate, ReadingColumns):
                total += candidate.columns(t, shape) @ self.coefficients(name)
            elif name in _BRANCHES:
                left = [
                    c * np.exp(-t / tau) for c, tau in zip(self.coefficients(name)[1::2], shape, strict=True)
                ]
                total += np.sum(left, axis=0)
        return total

    def _smooth(self) -> Floats:
        values = np.zeros(7)
        for name, shape in self.model.items():
            if name in _SMOOTH:
                values[list(_SMOOTH[name])] = self.coefficients(name)
            if name == "stiffness_change":
                values[6] = shape[0]
        return values

    def _dry(self) -> Floats:
        values = np.array([0.0, 0.0, 0.0, 1.0, 2.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, self.band])
        for name, shape in self.model.items():
            c = self.coefficients(name)
            if base_name(name) == "position_dependent_friction":
                values[5] = c[0]
            elif base_name(name) == "coulomb_friction":
                values[:2] = c[0], c[-1]
            elif base_name(name) == "stribeck_friction":
                values[:5] = c[0], c[0], c[1], shape[0], 1.0 if name.endswith("exponential") else 2.0
            elif base_name(name) == "presliding_hysteresis":
                values[6:8] = c[0], shape[0]
                if name.endswith("bristles"):
                    values[8] = c[1]
                elif len(shape) > 1:
                    values[9:11] = c[1], shape[1]
        return values


def first_order_hold(a: Floats, b: Floats, step_s: float) -> tuple[Floats, Floats, Floats]:
    """(Phi, G0, G1) of `z+ = Phi z + G0 u + G1 u+` for an input that is straight over the step.

    From the exponential of an augmented matrix (Van Loan, IEEE T-AC 23(3), 1978).
    """
    n = len(b)
    whole = np.zeros((n + 2, n + 2))
    whole[:n, :n], whole[:n, n], whole[n, n + 1] = a * step_s, b * step_s, 1.0
    e = expm(whole)
    ramp = e[:n, n + 1]
    return np.ascontiguousarray(e[:n, :n]), e[:n, n] - ramp, np.ascontiguousarray(ramp)


def _mass_error(regression: RecordingRegression, fit: ModelFit) -> float:
    """Standard error of the mass in N s^2/m, from the whitened normal equations."""
    design, _ = regression.design(fit.model)
    scale = np.sqrt(np.sum(design**2, axis=0))
    scale[scale == 0.0] = 1.0
    gram = (design / scale).T @ (design / scale)
    gram[np.diag_indices_from(gram)] += 1e-10
    inverse = np.linalg.inv(gram)[0, 0] / scale[0] ** 2
    return float(np.sqrt(inverse * fit.rss / max(1, fit.n - len(scale))))
