"""Both sides of the predictor in one thread, as an evaluation of a recording uses them."""

from math import inf, isfinite

from forefeel.common.causes.model import ContactModel
from forefeel.common.causes.motion import NO_COLUMNS, Columns
from forefeel.common.estimation.contact_prior import ContactPrior
from forefeel.common.estimation.evaluator import Estimate, Evaluator
from forefeel.common.estimation.learner import Learner


class Predictor:
    """Predicts the contact force at the newest own motion; see `Evaluator` and `Learner`.

    The stage is where the motion says, its velocity the difference of two positions.

        predictor.move(t_s, position_m)         # at each step: the own motion
        predictor.observe(stamp_s, force_n)     # when a force arrives: when it was measured, and its value
        predictor.predict()                     # the force now; None: nothing is known yet

    Args:
        model: of the contact, where one is known, such as `diagnosis.model.contact`.

    Attributes:
        columns: those that the model follows beside the motion.
    """

    def __init__(self, model: ContactModel | None = None, prior: ContactPrior | None = None) -> None:
        self.columns = () if model is None else model.columns
        self._evaluator = Evaluator()
        self.learner = Learner(self._evaluator, prior, model)
        self._evaluator.snapshot = self.learner.publish()
        self._unpublished = False
        self._last = (-inf, 0.0)

    def move(self, t_s: float, position_m: float, further: Columns = NO_COLUMNS) -> None:
        """Adds an own position and predicts there, to judge the experts; ignored if its stamp is no later
        or one of them is not finite.

        First hands the evaluator what `observe` has taught since.

        Args:
            further: values of the `columns`, by name.

        Raises:
            ValueError: one of them is missing.
        """
        if missing := [name for name in self.columns if name not in further]:
            raise ValueError(f"further: no {missing[0]!r}; expected the columns that the model follows")
        before_s, before_m = self._last
        self._publish()
        if t_s > before_s and isfinite(t_s) and isfinite(position_m):
            self._last = t_s, position_m
            velocity_m_s = (position_m - before_m) / (t_s - before_s)
            self._evaluator.move(t_s, position_m, position_m, velocity_m_s, further)
            self._evaluator.predict()

    def observe(self, stamp_s: float, force_n: float) -> None:
        self._evaluator.hear(stamp_s, force_n)
        self.learner.take(stamp_s, force_n)
        self._unpublished = True

    def predict(self) -> Estimate | None:
        self._publish()
        return self._evaluator.predict()

    def _publish(self) -> None:
        if self._unpublished:
            self._evaluator.snapshot = self.learner.publish()
            self._unpublished = False

    def restart(self) -> None:
        self._last = (-inf, 0.0)
        self._evaluator.restart()
