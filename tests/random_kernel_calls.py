"""Random calls of the kernels for the sanitizers: `python -m tests.random_kernel_calls COUNT SEED`.

Results are not compared. A sanitizer ends the process at an access outside a record or undefined arithmetic.
"""

import math
import sys
from random import Random

from forefeel.common.estimation.evaluator import Evaluator
from forefeel.common.estimation.learner import Learner

_ODD = 0.0, -0.0, 5e-324, 1e-9, 1e9, 1e300, -1e300, math.inf, -math.inf, math.nan


class RandomCalls:
    """One session: motion of a random period and scale, forces some samples late, rare values up to NaN."""

    def __init__(self, random: Random) -> None:
        self._random = random
        self._evaluator = Evaluator()
        self._learner = Learner(self._evaluator)
        self._period_s = 10.0 ** random.uniform(-3.5, -1.2)
        self._travel_m = 10.0 ** random.uniform(-6.0, 0.5)
        self._stiffness_n_m = random.choice((-1.0, 1.0)) * 10.0 ** random.uniform(-3.0, 6.0)
        self._delay = random.randrange(400)
        self._motion = [(0.0, 0.0)]

    def call(self) -> None:
        kinds = (self._move, self._observe, self._evaluator.predict, self._publish, self._evaluator.restart)
        self._random.choices(kinds, (40, 40, 15, 5, 0.05))[0]()

    def _move(self) -> None:
        periods = self._random.choices((1.0, 0.0, -3.0, 500.0), (96, 2, 1, 1))[0]
        t_s = self._motion[-1][0] + periods * self._period_s
        x_m = self._value(self._travel_m * math.sin(2.0 * t_s) * (math.sin(0.3 * t_s) > -0.7))
        self._evaluator.move(t_s, x_m, x_m, self._value(2.0 * self._travel_m * math.cos(2.0 * t_s)))
        self._motion.append((t_s, x_m))

    def _observe(self) -> None:
        t_s, x_m = self._motion[-1 - min(self._delay, len(self._motion) - 1)]
        force_n = self._value(self._stiffness_n_m * max(x_m, 0.0) + self._random.gauss(0.0, 1e-3))
        self._evaluator.hear(t_s, force_n)
        self._learner.take(t_s, force_n)

    def _publish(self) -> None:
        self._evaluator.snapshot = self._learner.publish()

    def _value(self, value: float) -> float:
        return self._random.choice(_ODD) if self._random.random() < 0.002 else value


def main(count: int, seed: int) -> None:
    random = Random(seed)
    for number in range(count):
        if number % 2000 == 0:
            session = RandomCalls(random)
        session.call()
    print(f"{count} random calls of the kernels, seed {seed}: no fault")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
