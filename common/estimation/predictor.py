"""Both sides of the predictor in one thread, as an evaluation of a recording uses them."""

from math import nan

from forefeel.common.estimation.evaluator import Estimate, Evaluator
from forefeel.common.estimation.learner import Learner


class Predictor:
    """Contact force at the own motion of now; see `Evaluator` and `Learner`."""

    def __init__(self) -> None:
        self._evaluator = Evaluator()
        self._learner = Learner(self._evaluator)
        self._learned = False

    @property
    def renewals(self) -> int:
        return self._learner.renewals

    def move(self, t_s: float, position_m: float, identified_n: float = nan, loaded_n: float = nan) -> None:
        self._evaluator.move(t_s, position_m, identified_n, loaded_n)

    def observe(self, stamp_s: float, force_n: float) -> None:
        self._evaluator.hear(stamp_s, force_n)
        self._learner.take(stamp_s, force_n)
        self._learned = True

    def predict(self) -> Estimate | None:
        if self._learned:
            self._evaluator.snapshot = self._learner.publish()
            self._learned = False
        return self._evaluator.predict()

    def restart(self) -> None:
        self._evaluator.restart()


def compile_kernels() -> None:
    """Compiles every kernel, or loads what an earlier process compiled; some 20 s the first time."""
    predictor = Predictor()
    for n in range(40):
        predictor.observe((n - 3) * 1e-3, float(n % 5))
        predictor.move(n * 1e-3, float(n % 7))
        predictor.predict()
