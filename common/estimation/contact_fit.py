"""The parameters of the contact model of `contact_model`, by variable projection.

Of rows i with weights w_i, force y_i and regressors phi_i(s) at the shape s:

    J(s, theta) = sum w (y - phi(s)' theta)^2 / sigma^2 + |theta - theta_0|^2 / P_0 + |s - s_0|^2 / S_0  (1)
    theta(s) = (sum w phi phi' / sigma^2 + P_0^-1)^-1 (sum w phi y / sigma^2 + P_0^-1 theta_0)           (2)

theta(s) is exact; s moves by damped Gauss-Newton steps on (theta, s) together, Kaufman's form of variable
projection. While the motion reaches new places, each coordinate of s is tried on a grid besides: in where the
contact begins and in the frequencies J has local minima.

theta_0, P_0, s_0, S_0 and sigma are those of an earlier session if there is one (`ContactPrior`). Without it
theta_0 = 0 and P_0 is relative to the spread of the force, so that no unit is needed. A term of one sign only
in a passive contact is 0 where (2) would make it negative. sigma^2 is the residual of the fit before per
degree of freedom. A model.yaml has no sigma: a fit that leaves over twice the expected sigma^2 is repeated
with its own, as the first second of forces made 15 N/m of a loaded 12. A fit over 3 standard deviations from
its prior drops it. Forces far from the predictions of the contact begin a new one, with the old one as prior.

Reference: Golub and Pereyra, Separable nonlinear least squares, Inverse Problems 19 (2003).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf, isfinite, nan

import numpy as np
from numpy.typing import NDArray

from forefeel.common.causes.model import ContactModel
from forefeel.common.estimation.contact_columns import Pause, RegressorColumns, motion_of
from forefeel.common.estimation.contact_model import (
    SHAPE,
    Array,
    Belief,
    Causes,
    MotionExtent,
    accepted,
    shape_slopes,
    typical_shape,
)
from forefeel.common.estimation.contact_prior import ContactPrior, widened
from forefeel.common.estimation.identifiability import analyse
from forefeel.common.estimation.path_force import PathForce, path_force

_TAKES_S = 0.25  # s of stamps from a fit's last sample to its use: it is computed beside the loop
_ROW_S = 1.0 / 60.0  # s between the rows of (1)
_INDEPENDENT_S = 0.1  # s of force that count as one independent value: residuals of (1) are correlated
_STEPS = 2  # Gauss-Newton steps a fit
_HALVINGS = 3  # of a step that does not lower J
# Occasional causes stay if they lower J by 10 % and by 20 (BIC, 3 parameters and their own shape).
_WORTH, _LEAST_WORTH = 0.1, 20.0
_LEAST_INDEPENDENT = 1.0  # independent values behind a term without a prior; a first moved row is 1 of 179
_COLD_NOISE = 0.05  # sigma over the spread of the force without a prior
_COLD_COUNT = 1.0  # independent values that this sigma counts as
_NOISIER = 2.0  # times the sigma^2 that was expected
_CONTRADICTION = 9.0  # mean square, in standard deviations, by which a fit may leave the prior: 3 sd
_RECENT_S = 1.0  # s of the newest forces that show a change of the contact
_RECALLED_S = 6.0  # s of motion up to them, for the states of friction and relaxation
_CHANGED = 5.0  # rms of their errors over sigma that counts as changed
CHANGED_BY = 2.0  # spread of a changed contact about the old one, over that between sessions
# Lead of the force by place over the causes: log of the ratio of the variances of what they leave of the last
# second, at most 1 a fit; what is left of it a fit later; with which it comes into use, and goes
_MOST_LEAD, _FADING, _LEADS, _TRAILS = 1.0, 0.85, 2.0, 0.5
_LEAST_N2 = 1e-18
TAUGHT_LEAD = 4.0  # of the force by place of a prior
_GRID = ((0, 24), (4, 11), (3, 15), (1, 7), (2, 5), (5, 5))  # coordinate of s, points
_STEP_OF_RANGE = 0.003  # difference in place of d/dx0, over the range
_DIFFERENCES = (0.02, 0.02, 5e-4, 5e-4, 0.05)  # in log L, log tau, Hz and log l
_SINGULAR = 1e-9  # relative information added to every direction, so that the inverse exists


@dataclass(frozen=True)
class Contact:
    """Parameters of a contact from a fit, or from a prior before any fit.

    Attributes:
        model: the causes at their shape. theta: their linear parameters, in the order of its regressors.
        names, values, standard_deviations, covariance: of all parameters, in SI units as the names say.
        noise_n: sigma, rms of the residual.
        identifiable: statements on parameters that the motion so far leaves undetermined.
        contact_s: seconds of contact from which it was learned.
        path, lead: the force by place, and its lead over the causes; `by_place`: it is in use for them.
        shape, occasional: start of the next fit.
        strain: mean square distance from the prior, in standard deviations of that.
        contradicted: the prior was dropped. since_s: stamp before which samples are of another contact.
    """

    model: ContactModel
    theta: tuple[float, ...]
    names: tuple[str, ...]
    values: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]
    noise_n: float
    identifiable: tuple[str, ...]
    contact_s: float
    shape: tuple[float, ...]
    occasional: bool = False
    strain: float = 0.0
    contradicted: bool = False
    since_s: float = -inf
    path: PathForce | None = None
    lead: float = 0.0
    by_place: bool = False

    @property
    def left_n(self) -> float:
        """rms of what the part in use, causes or force by place, leaves of the force."""
        return self.path.noise_n if self.path is not None and self.by_place else self.noise_n

    @property
    def standard_deviations(self) -> tuple[float, ...]:
        return tuple(row[i] ** 0.5 for i, row in enumerate(self.covariance))

    def prior(self) -> ContactPrior:
        """The contact as a prior for a later run; it contains the prior of this run, if there was one."""
        path = self.path if self.by_place else None
        return ContactPrior(self.names, self.values, self.covariance, self.contact_s, path)


@dataclass(frozen=True, eq=False)
class _Point:
    """A shape with its theta(s) and J; `acts`: mask of theta not held at 0, `p0`: diagonal of P_0^-1."""

    solver: "_Solver"
    shape: Array
    columns: Array
    theta: Array
    cost: float
    acts: NDArray[np.bool_]
    p0: Array

    @cached_property
    def normal_equations(self) -> tuple[Array, Array]:
        """A'A / sigma^2 and A'e / sigma^2 of A = (phi, d(phi theta)/d shape) and the residual e."""
        return self.solver.normal_equations(self)


@dataclass(frozen=True, eq=False)
class Fitting:
    """One fit as a job that owns its arrays; `solve` is pure.

    `samples`: shape (5 + columns, n), stamps in s, motion in m, m/s, m/s^2, force in N, columns beside.
    """

    causes: Causes
    samples: Array
    belief: Belief
    before: Contact | None
    searched: bool
    motion: MotionExtent
    contact_s: float

    @property
    def takes_effect_s(self) -> float:
        """Stamp in s of the first sample at whose arrival the result may be used."""
        return float(self.samples[0, -1]) + _TAKES_S

    def solve(self, pause: Pause = lambda: None) -> Contact | None:
        """Fits the contact and returns it; None if the samples allow none. Calls `pause` between its pieces.

        Fits the last second alone if the contact has changed, and sets its `since_s`; fits once more without
        a prior that the result contradicts, and sets `contradicted`.
        """
        with np.errstate(all="ignore"):
            try:
                residuals_n = self._recent_residuals_n()
                contact = self._solved(residuals_n, pause)
                return contact and self._with_path(contact, residuals_n)
            except np.linalg.LinAlgError:
                return None

    def _solved(self, residuals_n: Sequence[Array], pause: Pause) -> Contact | None:
        """Fits the causes. From the last second alone, as a changed contact, where causes and force by place
        both miss it by over 5 times the noise, unless grids are searched. Else from all samples, and once
        more without the prior if the result is over 3 standard deviations from it. None if no fit is finite.
        """
        if self.before is not None and not self.searched:
            least_n2 = min(float(np.mean(residual_n**2)) for residual_n in residuals_n)
            if least_n2 > (_CHANGED * self.before.noise_n) ** 2:
                return self._refitted(pause)
        contact = _Solver(self, pause).contact()
        if contact is None or contact.strain <= _CONTRADICTION:
            return contact
        cold = replace(self, belief=self.causes.belief(None), before=None, searched=True)
        contact = _Solver(cold, pause).contact()
        return contact and replace(contact, contradicted=True)

    def _recent_residuals_n(self) -> list[Array]:
        """Residuals in the last second, which no fit has seen: of the causes as fitted before, and of the
        force by place if there is one; empty before a first fit.
        """
        if self.before is None:
            return []
        motion = motion_of(self.causes, self.samples[:, self.samples[0] > self.samples[0, -1] - _RECALLED_S])
        columns = self.before.model.runtime().columns(motion, sensed=True)
        foretold = [columns @ np.array(self.before.theta)]
        foretold += [] if self.before.path is None else [self.before.path.along(motion.x)]
        recent = motion.t > motion.t[-1] - _RECENT_S
        return [(motion.force - force_n)[recent] for force_n in foretold]

    def _with_path(self, contact: Contact, residuals_n: Sequence[Array]) -> Contact:
        """Copy of the contact with a force by place, `path`, fitted to its samples. `lead` is by how much the
        former one has had smaller residuals than the causes, 0 unless `residuals_n` has both. `by_place` is
        True if that suffices to use it.
        """
        samples = self.samples[:, self.samples[0] >= contact.since_s]
        weights = np.minimum(np.diff(samples[0], prepend=samples[0, 0]) / _INDEPENDENT_S, 1.0)
        before = self.before or contact
        prior = None if contact.contradicted or contact.since_s > -inf else self.belief.path
        path = path_force(samples[1], samples[4], weights, before.path, prior)
        lead = 0.0
        if len(residuals_n) == 2:  # by how the force changes: what lasts comes back with the late force
            of_causes, of_path = (float(np.var(residual_n)) + _LEAST_N2 for residual_n in residuals_n)
            won = float(np.clip(np.log(of_causes / of_path), -_MOST_LEAD, _MOST_LEAD))
            lead = _FADING * before.lead + won
        by_place = path is not None and lead > (_TRAILS if before.by_place else _LEADS)
        return replace(contact, path=path, lead=lead, by_place=by_place)

    def _refitted(self, pause: Pause) -> Contact | None:
        """Fits the last second, with the contact so far as a wide prior, and sets `since_s`."""
        assert self.before is not None
        belief = self.causes.belief(widened(self.before.prior(), CHANGED_BY))
        samples = self.samples[:, self.samples[0] > self.samples[0, -1] - _RECENT_S]
        contact = _Solver(replace(self, samples=samples, belief=belief), pause).contact()
        return contact and replace(contact, since_s=float(samples[0, 0]))


class _Solver:
    """Minimises J of one job."""

    def __init__(self, job: Fitting, pause: Pause) -> None:
        self._pause = pause
        self._job, self._causes, self._belief = job, job.causes, job.belief
        t, y = job.samples[0], job.samples[4]
        rows = np.flatnonzero(np.diff(np.floor((t - t[0]) / _ROW_S), prepend=-1.0) > 0.0)
        w = np.minimum(np.diff(t[rows], prepend=t[0] - _ROW_S) / _INDEPENDENT_S, 1.0)
        self._y, self._count = y[rows] * np.sqrt(w), float(w.sum())
        self._spread2 = max(float(np.cov(y[rows], aweights=w, bias=True)), 1e-18)
        self._mean, self._sd = job.belief.shape_of(job.motion)
        self._columns = RegressorColumns(job.causes, job.samples, rows, np.sqrt(w), self._mean, pause)
        self._differences = np.array([_STEP_OF_RANGE * job.motion.range_m, *_DIFFERENCES])
        self._noise2_before, self._noise_count = self._spread2 * _COLD_NOISE**2, _COLD_COUNT
        if isfinite(job.belief.noise_n):
            self._noise2_before = job.belief.noise_n**2
            self._noise_count = 0.5 * (job.belief.noise_n / job.belief.noise_sd_n) ** 2
        noise_n = nan if job.before is None else job.before.noise_n
        noise2 = noise_n**2 if isfinite(noise_n) else self._noise2_before
        self._noise2 = max(noise2, 1e-6 * self._spread2)

    def contact(self) -> Contact | None:
        """Returns the contact of least J; None if it is not finite. Fits again, with the noise of the first
        fit, if that is over twice the assumed variance and the prior is of a model.yaml, which has no noise.
        """
        contact = self._fitted()
        of_model = bool(np.isfinite(self._belief.theta_sd).any()) and not isfinite(self._belief.noise_n)
        if of_model and contact is not None and contact.noise_n**2 > _NOISIER * self._noise2:
            self._noise2 = contact.noise_n**2
            contact = self._fitted()
        return contact

    def _fitted(self) -> Contact | None:
        """Returns the contact of least J, two steps from the former fit or the mean; None if not finite. A
        grid search comes first if the job asks for it. Occasional causes come or go where that lowers J, by a
        margin if not foreseen; a change costs another search and step.
        """
        before = self._job.before
        occasional = before is not None and before.occasional
        best = self._point(self._mean if before is None else np.array(before.shape), occasional)
        if self._job.searched:
            anew = self._point(self._mean, occasional)
            best = self._searched(min(best, anew, key=lambda point: point.cost), occasional)
        for _ in range(_STEPS):
            stepped = self._stepped(best, occasional)
            if stepped is best:
                break  # another would be the same
            best = stepped
        lean = self._point(best.shape, False) if occasional else best
        rich = best if occasional else self._point(best.shape, True)
        foreseen = bool(self._belief.theta[list(self._causes.occasional)].any())
        worth = rich.cost < (lean.cost if foreseen else (1.0 - _WORTH) * lean.cost - _LEAST_WORTH)
        if worth != occasional:
            best = self._stepped(self._searched(rich if worth else lean, worth), worth)
        return self._result(best, worth)

    def _point(self, shape: Array, occasional: bool) -> _Point:
        """Returns theta that minimises J at a shape, with that J; clips the shape to what causes accept. Held
        at 0 are occasional causes unless `occasional`, terms without a prior whose regressor hardly acts, and
        of the `positive` terms the most negative, one after another, until none is left.
        """
        shape = accepted(shape)
        z, noise2, belief = self._columns.at(shape), self._noise2, self._belief
        self._pause()
        gram = z.T @ z
        rms = self._rms(z)
        known = np.isfinite(belief.theta_sd)
        cold = self._causes.cold * np.sqrt(self._spread2) / np.maximum(rms, self._causes.least)
        p0 = np.where(known, belief.theta_sd, cold) ** -2.0
        information = (gram / noise2 + np.diag(p0)) / np.outer(rms, rms)
        moments = (z.T @ self._y / noise2 + p0 * belief.theta) / rms
        acts = known | (self._independent(z, rms) >= _LEAST_INDEPENDENT)
        if not occasional:
            acts[list(self._causes.occasional)] = False
        scaled = np.zeros(len(rms))
        while True:
            at = np.flatnonzero(acts)
            scaled[:] = 0.0
            scaled[at] = np.linalg.solve(information[np.ix_(at, at)], moments[at])
            worst = min(self._causes.positive, key=lambda i: scaled[i])
            if scaled[worst] >= 0.0:
                break
            acts[worst] = False
        off = (shape - self._mean) / self._sd
        cost = self._y @ self._y / noise2 + p0 @ belief.theta**2 - scaled @ moments + off @ off
        return _Point(self, shape, z, scaled / rms, float(cost), acts, p0)

    def _independent(self, columns: Array, rms: Array) -> Array:
        """Number of independent values behind each column of phi: (sum z^2)^2 / sum z^4 of its rows."""
        squares = (columns / rms) ** 2
        fourth = np.einsum("ij,ij->j", squares, squares)
        return np.asarray(self._count**3 / len(self._y) / np.maximum(fourth, 1e-12))

    def _rms(self, columns: Array) -> Array:
        """rms of each column of phi; 1 for a column of zeros."""
        rms = np.sqrt(np.einsum("ij,ij->j", columns, columns) / self._count)
        return np.where(rms > 0.0, rms, 1.0)

    def _searched(self, point: _Point, occasional: bool) -> _Point:
        """Returns the point of least J among the given one and grids along each coordinate of the shape.
        Tries one after another, from the best shape so far. The place of the contact is tried over the range
        of motion, other coordinates over 2 standard deviations to each side of the mean.
        """
        for i, count in _GRID:
            grid = self._mean[i] + self._sd[i] * np.linspace(-2.0, 2.0, count)
            if i == 0:
                grid = np.linspace(self._job.motion.low_m, self._job.motion.high_m, count + 2)[1:-1]
            for value in grid:
                shape = point.shape.copy()
                shape[i] = value
                point = min(point, self._point(shape, occasional), key=lambda p: p.cost)
        return point

    def normal_equations(self, point: _Point) -> tuple[Array, Array]:
        """Returns A'A / sigma^2 and A'e / sigma^2 at a point, without the prior: A the derivatives of the
        prediction by (theta, shape), the latter by differences, e the residuals. Calls `_pause`.
        """
        tangents = []
        for i, difference in enumerate(self._differences):
            shape = point.shape.copy()
            shape[i] += difference
            tangents.append((self._columns.at(shape) - point.columns) @ point.theta / difference)
        self._pause()
        a = np.column_stack([point.columns, *tangents])
        e = self._y - point.columns @ point.theta
        return a.T @ a / self._noise2, a.T @ e / self._noise2

    def _free(self, point: _Point) -> NDArray[np.bool_]:
        """Mask of (theta, s) that are not held at 0."""
        return np.append(point.acts, np.ones(len(self._sd), dtype=bool))

    def _stepped(self, point: _Point, occasional: bool) -> _Point:
        """Returns the point after a Gauss-Newton step of the shape that lowers J; the same if none does. A
        step that does not is cut to 0.3 of its length, three tries in all. It is at most one standard
        deviation in each coordinate, and the shape stays within 3 of the mean.
        """
        gathered, pull = point.normal_equations
        p0 = np.concatenate([point.p0, self._sd**-2.0])
        pull = pull - p0 * np.concatenate([point.theta - self._belief.theta, point.shape - self._mean])
        at = np.flatnonzero(self._free(point))
        information = (gathered + np.diag(p0))[np.ix_(at, at)]
        size = np.sqrt(np.diagonal(information))
        step = np.linalg.solve(information / np.outer(size, size), pull[at] / size) / size
        step = np.clip(step[-len(self._sd) :], -self._sd, self._sd)
        if not np.isfinite(step).all():
            return point  # some causes at their bounds overflow
        for _ in range(_HALVINGS):
            shape = np.clip(point.shape + step, self._mean - 3.0 * self._sd, self._mean + 3.0 * self._sd)
            other = self._point(shape, occasional)
            if other.cost < point.cost:
                return other
            step = 0.3 * step
        return point

    def _result(self, point: _Point, occasional: bool) -> Contact | None:
        """Returns the contact at a point, with covariance, noise and statements; None if not finite.
        Parameters held at 0 have the variance of the prior.
        """
        gathered, _ = point.normal_equations
        acts = self._free(point)
        information = np.where(np.outer(acts, acts), gathered, 0.0)
        information += np.diag(np.concatenate([point.p0, self._sd**-2.0]))
        size = np.sqrt(np.diagonal(information))
        scaled = information / np.outer(size, size) + _SINGULAR * np.eye(len(size))
        covariance = np.linalg.inv(scaled) / np.outer(size, size)
        e = self._y - point.columns @ point.theta
        used = float(np.sum((covariance * gathered)[np.ix_(acts, acts)]))
        count = max(self._count - used, 1.0) + self._noise_count
        noise_n = float(np.sqrt((e @ e + self._noise_count * self._noise2_before) / count))
        values, of_named = self._causes.named(point.theta, point.shape, covariance)
        named = np.zeros((len(values) + 1, len(values) + 1))
        named[:-1, :-1] = 0.5 * (of_named + of_named.T)
        named[-1, -1] = 0.5 * noise_n**2 / count
        if not (np.isfinite(named).all() and np.isfinite(values).all()):
            return None
        return Contact(
            model=self._causes.model(point.shape, float(self._job.samples[0, -1])),
            theta=tuple(point.theta.tolist()),
            names=self._causes.names,
            values=(*values.tolist(), noise_n),
            covariance=tuple(map(tuple, named.tolist())),
            noise_n=noise_n,
            identifiable=self._undetermined(point, gathered, occasional),
            contact_s=self._job.contact_s,
            shape=tuple(point.shape.tolist()),
            occasional=occasional,
            strain=self._strain(point),
        )

    def _strain(self, point: _Point) -> float:
        """Mean square distance of a point from the prior, in its standard deviations; 0 without a prior."""
        of_theta = ((point.theta - self._belief.theta) / self._belief.theta_sd)[self._causes.forces]
        of_shape = (point.shape - self._belief.shape) / self._belief.shape_sd
        off = np.concatenate([of_theta, of_shape])
        return float(np.nanmean(off**2)) if np.isfinite(off).any() else 0.0

    def _undetermined(self, point: _Point, gathered: Array, occasional: bool) -> tuple[str, ...]:
        """Returns statements on parameters that the rows leave as unknown as they were before any force.
        Empty if there are none; occasional causes count only if `occasional`. `gathered`: A'A / sigma^2 of
        (theta, shape), see `normal_equations`. Calls `_pause`.
        """
        self._pause()
        left_out = () if occasional else self._causes.occasional
        forces = [i for i in self._causes.forces if i not in left_out]
        n = len(point.theta)
        names = [*(self._causes.linear[i] for i in forces), *SHAPE]
        of_theta = np.sqrt(self._spread2) / self._rms(point.columns)[forces]
        _, of_shape = typical_shape(self._job.motion)
        at = [*forces, *range(n, n + len(of_shape))]
        sd = np.concatenate([of_theta, of_shape])
        slopes = np.concatenate([np.ones(len(forces)), shape_slopes(point.shape)])
        scaled = gathered[np.ix_(at, at)] * np.outer(sd, sd)
        self._pause()
        return analyse(scaled, names, (1.0 / (sd * slopes)).tolist())
