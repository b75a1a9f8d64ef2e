"""Contact that is learned while it is touched, and evaluated in the haptic loop; the fits: `contact_fit`.

`ContactFit` collects samples beside the loop and hands out a fit every .75 s; `ContactExpert` evaluates the
newest result in the loop. All times are stamps of commands.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import inf, isfinite, nan
from operator import mul

import numpy as np

from forefeel.common.causes.model import ContactModel
from forefeel.common.causes.motion import NO_COLUMNS, Columns
from forefeel.common.causes.runtime import ContactRuntime
from forefeel.common.estimation.contact_fit import CHANGED_BY, TAUGHT_LEAD, Contact, Fitting
from forefeel.common.estimation.contact_model import Causes, MotionExtent
from forefeel.common.estimation.contact_prior import ContactPrior, widened
from forefeel.common.estimation.path_force import PathForce
from forefeel.common.estimation.sensor_model import Sense, SensorModel
from forefeel.common.estimation.state_filter import GAP_S

__all__ = ["Contact", "ContactExpert", "ContactFit", "Fitting"]

_EVERY_S = 0.75  # s between two fits
_WINDOW_S = 30.0  # s of samples in a fit
_STEP_S = 0.004  # s between samples: friction and relaxation follow their motion
_NEW_S = 3.0  # s of searching on grids since the range of the motion has grown: 6 s predict no better
_GROWN = 1.1  # ratio of ranges that counts as grown
# bounds of the samples of any instrument
_MOST_M, _MOST_M_S, _MOST_M_S2, _MOST_N = 100.0, 1e3, 1e6, 1e4
_LEAST_RANGE_M = 1e-6  # m, range of motion below which there is nothing to fit


class ContactFit:
    """Collects samples and hands out fits, one at a time. Time is that of the stamps.

    Args:
        prior: of an earlier session, used as given, see `widened`.
        loaded: a model of a diagnosis: its causes are added, and its values where the prior has none.

    Attributes:
        contact: the newest one; None before a fit without prior and model.
    """

    def __init__(self, prior: ContactPrior | None = None, loaded: ContactModel | None = None) -> None:
        self._causes = Causes(loaded)
        prior = self._causes.with_loaded(prior)
        self._sensor = SensorModel(loaded or ContactModel("", ()))
        self._belief = self._causes.belief(prior)
        self.contact = None if prior is None else self._of_prior(prior)
        self._contact_s = 0.0 if prior is None else prior.contact_s
        self._samples = np.empty((5 + len(self._causes.columns), 2 * int(_WINDOW_S / _STEP_S)))
        self._low_m, self._high_m, self._searched_range_m = inf, -inf, 0.0
        self._new_until_s, self._due_s, self._newest_s = -inf, inf, -inf
        self._under_way = False
        self._n = 0

    def _of_prior(self, prior: ContactPrior) -> Contact:
        """Returns a contact with the names, values and covariance of a prior, as before any sample. Model,
        theta and noise are those of `self._belief`, which has to follow from that prior.
        """
        shape, _ = self._belief.shape_of(MotionExtent(0.0, 0.0))
        return Contact(
            model=self._causes.model(shape, 0.0),
            theta=tuple(self._belief.theta.tolist()),
            names=prior.names,
            values=prior.values,
            covariance=prior.covariance,
            noise_n=self._belief.noise_n,
            identifiable=(),
            contact_s=prior.contact_s,
            path=prior.path,
            by_place=prior.path is not None,
            lead=TAUGHT_LEAD,
            shape=tuple(shape.tolist()),
            occasional=bool(self._belief.theta[list(self._causes.occasional)].any()),
        )

    def observe(
        self,
        t_s: float,
        x_m: float,
        v_m_s: float,
        a_m_s2: float,
        force_n: float,
        further: Columns = NO_COLUMNS,
    ) -> None:
        """Adds a sample: the motion at a command's stamp, the force in N that answers it, the columns beside.

        Ignores one that is out of order, under about 4 ms after the last, not finite, out of bounds or at the
        end of the sensor's range. Extends the range of motion and the time in contact. Before any motion,
        drops all samples every 0.75 s. A full buffer drops its older half.
        """
        dt = t_s - self._newest_s if self._n else inf
        if dt < 0.9 * _STEP_S or not isfinite(t_s) or self._sensor.at_limit(force_n):
            return
        if not (abs(x_m) <= _MOST_M and abs(v_m_s) <= _MOST_M_S and abs(a_m_s2) <= _MOST_M_S2):
            return
        if not abs(force_n) <= _MOST_N:
            return
        if self._n == 0:
            self._due_s = t_s + _EVERY_S
        elif self._searched_range_m == 0.0 and t_s - self._samples[0, 0] > _EVERY_S:
            # The noise of a long rest before the first motion would count as that of the motion.
            self._n, self._due_s = 0, -inf
        if dt > GAP_S:
            v_m_s = 0.0  # the states stay: the motion in a gap is unknown
        if self._n == self._samples.shape[1]:
            self._n //= 2
            self._samples[:, : self._n] = self._samples[:, self._n :]
        beside = (further.get(name, 0.0) for name in self._causes.columns)
        self._samples[:, self._n] = t_s, x_m, v_m_s, a_m_s2, force_n, *beside
        self._n += 1
        self._newest_s = t_s
        if self.contact is not None and x_m > self.contact.shape[0]:
            self._contact_s += min(dt, GAP_S)
        self._low_m, self._high_m = min(self._low_m, x_m), max(self._high_m, x_m)
        if self._high_m - self._low_m > max(_GROWN * self._searched_range_m, _LEAST_RANGE_M):
            self._searched_range_m = self._high_m - self._low_m
            if self._due_s == -inf:
                self._due_s = t_s + _EVERY_S
            self._new_until_s = t_s + _NEW_S

    def due(self) -> Fitting | None:
        """Returns a job to fit the newest 30 s, every 0.75 s of stamps, and marks it as under way.

        Returns None if it is too early, before `apply` has taken the last result, or before any motion.
        """
        if self._under_way or self._searched_range_m == 0.0:
            return None
        t_s = self._newest_s
        if t_s < self._due_s:
            return None
        self._due_s, self._under_way = t_s + _EVERY_S, True
        first = int(np.searchsorted(self._samples[0, : self._n], t_s - _WINDOW_S))
        samples = self._samples[:, first : self._n].copy()
        return Fitting(
            causes=self._causes,
            samples=samples,
            belief=self._belief,
            before=self.contact,
            searched=t_s < self._new_until_s,
            motion=MotionExtent(self._low_m, self._high_m),
            contact_s=self._contact_s,
        )

    def apply(self, contact: Contact | None) -> None:
        """Takes the result of the last job as `contact`; None discards all samples and the range of motion.

        If `contradicted`, the belief is that without a prior. A finite `since_s`, a change, makes the new
        contact a wide prior and drops the samples before it.
        """
        self._under_way = False
        if contact is None:
            self._n = 0
            self._searched_range_m = 0.0
            self._low_m, self._high_m = inf, -inf
        else:
            self.contact = contact
            if contact.contradicted:
                self._belief = self._causes.belief(None)
            if contact.since_s > -inf:
                changed = self._causes.belief(widened(contact.prior(), CHANGED_BY))
                self._belief = replace(changed, path=None)
                retained = self._samples[:, : self._n][:, self._samples[0, : self._n] >= contact.since_s]
                self._n = retained.shape[1]
                self._samples[:, : self._n] = retained


class ContactExpert:
    """Computes the force of a contact along a motion, in the haptic loop.

    Attributes:
        steps_n: by how much the changes of the contact so far have lowered its reading, in N; they pass the
            lags and delays of its sensor as the force does.
    """

    def __init__(self) -> None:
        self._runtime: ContactRuntime | None = None
        self._sensor = SensorModel(ContactModel("", ()))
        self._theta: tuple[float, ...] = ()
        self._effects: Sequence[tuple[str, str | None]] = ()
        self._sum_n = self.steps_n = 0.0
        self._force_n, self._renewed = nan, False
        self._path: PathForce | None = None
        self._direction, self._x_m = 0.0, nan
        self._sense: Sense = self._sensor.chain()
        self._sense_steps: Sense = self._sensor.chain()

    def use(self, contact: Contact) -> None:
        """Switches to a contact; the states of friction and relaxation stay if it has the same effects. The
        next `move` adds the step in force that this makes to `steps_n`.
        """
        effects = [(entry.effect, entry.site) for entry in contact.model.effects]
        if self._runtime is None or effects != self._effects:
            self._runtime, self._sensor = contact.model.runtime(), SensorModel(contact.model)
            self._sense, self._sense_steps = self._sensor.chain(), self._sensor.chain()
            self._effects = effects
        else:
            self._runtime.revalue([dict(entry.parameters) for entry in contact.model.effects])
        self._theta, self._renewed = contact.theta, True
        self._path = contact.path if contact.by_place else None

    def move(
        self, t_s: float, x_m: float, v_m_s: float, a_m_s2: float, dt_s: float, further: Columns = NO_COLUMNS
    ) -> float:
        """Advances the contact by `dt_s` and returns its reading in N, with its sensor's lags, delays and
        range: from the force by place if that is in use, else from the causes. NaN before `use`. Sets
        `steps_n`.
        """
        if self._runtime is None:
            return nan
        self._runtime.follow(further)
        phi = self._runtime.regressors(t_s, x_m, v_m_s, a_m_s2, dt_s)  # its states go on in any case
        if self._path is None:
            force_n: float = sum(map(mul, self._theta, phi))
        else:
            if isfinite(self._x_m):
                direction = self._direction + (x_m - self._x_m) / self._path.length_m
                self._direction = -1.0 if direction < -1.0 else 1.0 if direction > 1.0 else direction
            force_n = self._path.at(x_m, self._direction)
        self._x_m = x_m
        if self._renewed and isfinite(self._force_n - force_n):
            self._sum_n += self._force_n - force_n
        self._force_n, self._renewed = force_n, False
        self.steps_n = self._sense_steps(t_s, self._sum_n, dt_s)
        return self._sensor.limited(self._sense(t_s, force_n, dt_s))

    def reset(self) -> None:
        """Clears the states, as after a new grip."""
        self._force_n, self._renewed = nan, False
        self._sense, self._sense_steps = self._sensor.chain(), self._sensor.chain()
        if self._runtime is not None:
            self._runtime.reset()
