"""Predictors of the literature behind the port of `forefeel evaluate`, for `benchmarks.prediction`.

All learn online from the forces that have arrived. Their constants are those of a few that gave the smallest
geometric mean on the recordings at 300 ms, so they are shown at their best.
"""

from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Mapping
from importlib import import_module
from math import exp, inf
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from forefeel.common.estimation.evaluator import Estimate
from forefeel.diagnosis.evaluation.methods import Method, Pairs

Array = NDArray[np.float64]

_LAGS_S = 0.02, 0.05, 0.1, 0.2, 0.4, 0.8
_VELOCITY_S = 0.02  # s over which a velocity is a difference
_ROW_S = 0.02  # s between two rows that are learned from
_ROWS, _FIRST_ROWS = 3000, 50  # a minute of them, the newest; those before the first fit
_REFIT_S = 1.0
_RIDGE = 0.01  # of the mean square of a regressor
_KERNEL_ROWS, _KERNEL_RIDGE = 400, 0.1
_UNITS = 100  # of the reservoir
_RESERVOIR_S = 0.01  # s between two steps of the reservoir
_STIFFNESS_MEMORY_S = 2.0


class History:
    """Values by their stamps."""

    def __init__(self) -> None:
        self._stamps_s: list[float] = []
        self._values: list[float] = []

    def add(self, stamp_s: float, value: float) -> None:
        index = bisect_right(self._stamps_s, stamp_s)
        self._stamps_s.insert(index, stamp_s)
        self._values.insert(index, value)

    def at(self, t_s: float) -> tuple[float, float]:
        """(stamp, value) of the newest value that is not after `t_s`, else of the first."""
        index = max(bisect_right(self._stamps_s, t_s) - 1, 0)
        return self._stamps_s[index], self._values[index]


class Regression(Protocol):
    def fit(self, rows: Array, targets: Array) -> None: ...

    def __call__(self, row: Array) -> float: ...


class Ridge:
    """Linear, by the normal equations; each regressor by its rms."""

    def fit(self, rows: Array, targets: Array) -> None:
        size = np.sqrt(np.mean(rows**2, axis=0)) + np.finfo(float).tiny
        z = rows / size
        moments = z.T @ z + _RIDGE * len(z) * np.eye(z.shape[1])
        self._theta = np.linalg.solve(moments, z.T @ targets) / size

    def __call__(self, row: Array) -> float:
        return float(row @ self._theta)


class KernelRidge:
    """scikit-learn's, radial basis functions on 400 of the rows, each regressor standardised.

    Its `predict` checks the input for longer than the sum takes; here is the sum.
    """

    def __init__(self) -> None:
        self._package: Any = import_module("sklearn.kernel_ridge")

    def fit(self, rows: Array, targets: Array) -> None:
        chosen = np.unique(np.linspace(0, len(rows) - 1, _KERNEL_ROWS).astype(int))
        self._mean, self._size = rows.mean(axis=0), rows.std(axis=0) + np.finfo(float).tiny
        self._unit_n = float(np.sqrt(np.mean(targets**2))) or 1.0
        self._gamma = 1.0 / rows.shape[1]
        self._rows = (rows[chosen] - self._mean) / self._size
        model = self._package.KernelRidge(kernel="rbf", gamma=self._gamma, alpha=_KERNEL_RIDGE)
        self._dual = model.fit(self._rows, targets[chosen] / self._unit_n).dual_coef_ * self._unit_n

    def __call__(self, row: Array) -> float:
        apart = self._rows - (row - self._mean) / self._size
        return float(np.exp(-self._gamma * np.einsum("ij,ij->i", apart, apart)) @ self._dual)


class Incremental:
    """f(t) = f(s) + g(phi), s the stamp of the newest force; g is fitted anew every second.

    phi is what was known at t, so that g is fitted for the delay as it is.
    """

    def __init__(self, regression: Regression) -> None:
        self._regression = regression
        self._x, self._f = History(), History()
        self._pairs = Pairs[tuple[Array, float]]()
        self._rows: deque[Array] = deque(maxlen=_ROWS)
        self._targets_n: deque[float] = deque(maxlen=_ROWS)
        self._row_s = self._fitted_s = -inf
        self._force_n: float | None = None
        self._fitted = False
        self.restart()

    def restart(self) -> None:
        self._start_s: float | None = None

    def observe(self, stamp_s: float, force_n: float) -> None:
        self._f.add(stamp_s, force_n)
        self._pairs.arrived(stamp_s, force_n)

    def move(self, t_s: float, position_m: float) -> None:
        """Learns from what arrived, then predicts."""
        self._x.add(t_s, position_m)
        if self._start_s is None:
            self._start_s = t_s
        self._learn(t_s)
        try:
            s, zoh_n = self._f.at(inf)
        except IndexError:  # no force yet
            return
        row = np.array(self.regressors(t_s, s))
        if t_s - self._row_s >= _ROW_S:
            self._pairs.remember(t_s, (row, zoh_n))
            self._row_s = t_s
        self._force_n = zoh_n + self._regression(row) if self._fitted else None

    def _learn(self, t_s: float) -> None:
        for _, (row, zoh_n), force_n in self._pairs.take():
            self._rows.append(row)
            self._targets_n.append(force_n - zoh_n)
        if len(self._rows) >= _FIRST_ROWS and t_s - self._fitted_s >= _REFIT_S:
            self._regression.fit(np.array(self._rows), np.array(self._targets_n))
            self._fitted, self._fitted_s = True, t_s

    def predict(self) -> Estimate | None:
        return None if self._force_n is None else Estimate(self._force_n)

    def regressors(self, t_s: float, s: float) -> list[float]:
        """phi at `t_s`, with the newest force of stamp `s`."""
        raise NotImplementedError

    def change(self, of: History, t_s: float, lag_s: float) -> float:
        """From `lag_s` before `t_s` to `t_s`; nothing of before a gap."""
        return of.at(t_s)[1] - of.at(self._before(t_s, lag_s))[1]

    def velocity(self, t_s: float) -> float:
        now_s, now_m = self._x.at(t_s)
        then_s, then_m = self._x.at(self._before(now_s, _VELOCITY_S))
        return (now_m - then_m) / (now_s - then_s) if now_s > then_s else 0.0

    def _before(self, t_s: float, lag_s: float) -> float:
        start_s = -inf if self._start_s is None else self._start_s
        return min(max(t_s - lag_s, start_s), t_s)


class Autoregression(Incremental):
    """ARX, direct for the delay: histories of force and motion at s, of motion at t."""

    def regressors(self, t_s: float, s: float) -> list[float]:
        moved_m = self._x.at(t_s)[1] - self._x.at(s)[1]
        return [
            1.0,
            moved_m,
            self.velocity(t_s) - self.velocity(s),
            *(self.change(self._f, s, lag_s) for lag_s in _LAGS_S),
            *(self.change(self._x, s, lag_s) for lag_s in _LAGS_S),
            *(self.change(self._x, t_s, lag_s) for lag_s in _LAGS_S),
        ]


class Kernel(Incremental):
    """Kernel ridge regression on the state of the motion at t and at s, and on the force with its trend."""

    def regressors(self, t_s: float, s: float) -> list[float]:
        return [
            self._x.at(t_s)[1],
            self.velocity(t_s),
            self._x.at(t_s)[1] - self._x.at(s)[1],
            self.velocity(s),
            self._f.at(s)[1],
            self.change(self._f, s, 0.1),
        ]


class EchoState(Incremental):
    """A reservoir of reservoirpy, driven by position, velocity and the newest force, each by its largest size
    so far; a ridge reads it out, beside what drives it.
    """

    def __init__(self, regression: Regression) -> None:
        nodes: Any = import_module("reservoirpy.nodes")
        self._reservoir = nodes.Reservoir(_UNITS, lr=0.3, sr=0.9, input_connectivity=0.5, seed=1)
        self._reservoir.run(np.zeros((1, 3)))
        self._largest = np.full(3, np.finfo(float).tiny)
        self._origin: Array | None = None
        super().__init__(regression)

    def restart(self) -> None:
        super().restart()
        self._reservoir.reset()
        self._state, self._stepped_s = np.zeros(_UNITS), -inf

    def regressors(self, t_s: float, s: float) -> list[float]:
        now = np.array([self._x.at(t_s)[1], self.velocity(t_s), self._f.at(s)[1]])
        if self._origin is None:
            self._origin = now * (1.0, 0.0, 1.0)
        driving = now - self._origin
        self._largest = np.maximum(self._largest, np.abs(driving))
        driving /= self._largest
        if t_s - self._stepped_s >= _RESERVOIR_S:
            self._state, self._stepped_s = self._reservoir.step(driving), t_s
        return [1.0, self._x.at(t_s)[1] - self._x.at(s)[1], *driving, *self._state]


class ConstantStiffness:
    """Delay compensation by a model of one stiffness, as in model-mediated teleoperation:

        f(t) = f(s) + k (x(t) - x(s)),

    k by recursive least squares of f on x and 1 with a memory of 2 s. Xu, Cizmeci, Schuwerk and Steinbach,
    Model-mediated teleoperation: toward stable and transparent teleoperation systems, IEEE Access 4 (2016).
    """

    def __init__(self) -> None:
        self._pairs = Pairs[float]()
        self._moments = np.zeros(5)  # of 1, x, f, x^2, x f
        self._k = 0.0
        self._learned: tuple[float, float, float] | None = None  # stamp, position, force of the newest
        self._origin_m: float | None = None
        self._x = 0.0

    def restart(self) -> None: ...

    def observe(self, stamp_s: float, force_n: float) -> None:
        self._pairs.arrived(stamp_s, force_n)

    def move(self, t_s: float, position_m: float) -> None:
        """Learns k from what arrived."""
        if self._origin_m is None:
            self._origin_m = position_m
        self._x = position_m - self._origin_m
        self._pairs.remember(t_s, self._x)
        for stamp_s, x, force_n in self._pairs.take():
            age_s = stamp_s - (self._learned[0] if self._learned else stamp_s)
            self._moments *= exp(-max(age_s, 0.0) / _STIFFNESS_MEMORY_S)
            self._moments += (1.0, x, force_n, x * x, x * force_n)
            if age_s >= 0.0:
                self._learned = stamp_s, x, force_n
        n, x, f, xx, xf = self._moments.tolist()
        spread = n * xx - x * x
        self._k = (n * xf - x * f) / spread if spread > 1e-12 * n * xx else 0.0

    def predict(self) -> Estimate | None:
        if self._learned is None:
            return None
        _, x, force_n = self._learned
        return Estimate(force_n + self._k * (self._x - x))


PEERS: Mapping[str, tuple[str, Callable[[], Method]]] = {
    "autoregression": ("numpy", lambda: Autoregression(Ridge())),
    "echo_state": ("reservoirpy", lambda: EchoState(Ridge())),
    "kernel_ridge": ("sklearn", lambda: Kernel(KernelRidge())),
    "constant_stiffness": ("numpy", ConstantStiffness),
}
"""The package that each needs, and what makes it."""
