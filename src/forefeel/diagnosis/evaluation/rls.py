"""Recursive least squares that survives hold and collinear motion.

Letters of the paper: regressor phi, parameters theta, covariance P (in units of the noise variance), gain K,
innovation e (a priori), forgetting factor lambda. One accepted sample is the paper's

    (9)   K = P phi / (lambda + phi' P phi)
    (10)  P = (I - K phi') P / lambda
    (11)  e = y - phi' theta
    (12)  theta = theta + K e

on the factors of P = U D U'. What is added to the paper:

- lambda = exp(-dt / memory_s): the memory is in seconds, whatever the rate, and dt may vary.
- Information gate: a sample with phi' P phi <= 1 - lambda brings less than forgetting takes; theta, P stay.
- Floor of information: forgetting returns to the prior P0, not to infinity:
  `inv(P) = lambda inv(P) + (1 - lambda) inv(P0) + phi phi'` (Salgado, Goodwin and Middleton, Int. J. Control
  47, 1988). The gate alone does not stop wind-up when the motion is collinear (pure sine): the excited
  directions keep it open. The middle term is a measurement "theta_i is what it is", so theta is not pulled.
- Scaling: U D U' is indifferent to a diagonal scaling of phi, so scales enter through P0 alone.
- Reported parameters obey physical bounds, see `parameters`.
"""

from collections.abc import Sequence
from math import exp, inf

Matrix = list[list[float]]

PRIOR_VARIANCE = 100.0
"""Of P0 for scaled regressors, in units of the noise variance: all the prior counts as much as a hundredth of
a sample of usual size."""

_TOP_UP_AT = 0.02
"""Forgotten fraction after which the prior's information is topped up: seldom, yet at most 2 % below it."""

_ABSURD = 1e12
"""phi' P phi above which a regressor is an error of its source: it would outweigh all later samples."""

_TINY = 1e-300
"""Stands for a variance that rounding has made zero."""

_LEAST_LAMBDA = 0.01
"""Keeps lambda above zero when dt is many memories long."""


class RecursiveLeastSquares:
    """Gated, bounded, exponentially forgetting least squares for n linear parameters, from theta = 0 (8).

    Args:
        scales: typical magnitude of each regressor, > 0; P0 is diagonal with PRIOR_VARIANCE / scales_i^2.
        memory_s: time constant of forgetting in s; `math.inf` never forgets (lambda = 1, gate open).
        bounds: (lower, upper) of each reported parameter; none by default.

    Attributes:
        updates: samples that were accepted.
    """

    def __init__(
        self,
        scales: Sequence[float],
        memory_s: float,
        bounds: Sequence[tuple[float, float]] | None = None,
    ) -> None:
        self.scales = tuple(scales)
        self._memory_s = memory_s
        self._bounds = bounds or ((-inf, inf),) * len(scales)
        self.updates = 0
        self._theta = [0.0] * len(scales)
        self._prior = [PRIOR_VARIANCE / (s * s) for s in scales]
        self._p = UdCovariance(self._prior)
        self._forgotten = 0.0

    def update(self, phi: Sequence[float], y: float, dt: float) -> None:
        """Learns from a sample, dt seconds after the last, and counts it in `updates`. Ignores one that is
        not finite, has dt < 0, is absurd (phi' P phi >= 1e12), or tells less than forgetting takes (phi' P
        phi <= 1 - lambda).
        """
        e = y
        for i, theta in enumerate(self._theta):
            e -= phi[i] * theta
        f, v, power = self._p.project(phi)
        # NaN and infinity anywhere in phi, y, dt, and what overflows on the way, fail these comparisons.
        if not (e * e < inf and power < _ABSURD and 0.0 <= dt < inf):
            return
        lam = max(exp(-dt / self._memory_s), _LEAST_LAMBDA)
        if power > 1.0 - lam:
            self._correct(f, v, lam, e)

    def _correct(self, f: list[float], v: list[float], lam: float, e: float) -> None:
        """Updates theta and P by the gain K = P phi / alpha and the innovation `e`, and counts the sample;
        once 2 % are forgotten, restores that share of the prior's information in P. `f`, `v`: of `project`;
        `v` is overwritten.
        """
        p_phi, alpha = self._p.correct(f, v, lam)
        step = e / alpha
        theta = self._theta
        for i, k in enumerate(p_phi):
            theta[i] += k * step
        self.updates += 1
        self._forgotten += 1.0 - lam
        if self._forgotten >= _TOP_UP_AT:
            for i, variance in enumerate(self._prior):
                self._p.inform(i, self._forgotten / variance)
            self._forgotten = 0.0

    @property
    def covariance(self) -> Matrix:
        """P in units of the noise variance; exactly symmetric."""
        return self._p.matrix

    @property
    def theta(self) -> tuple[float, ...]:
        """The unconstrained parameters, to which the innovations refer."""
        return tuple(self._theta)

    @property
    def parameters(self) -> tuple[float, ...]:
        """The parameters within their bounds.

        Where theta violates a bound, that parameter is set on it and the others move along: the mean of
        N(theta, P) given theta_i = bound, worst violation first. So the fit is kept where the motion can not
        tell parameters apart, which clamping alone would spoil: at 1 rad/s, m = -0.5 and k = 0.5 become m = 0
        and k = 1. The state is not touched.
        """
        theta, p = list(self._theta), self._p.matrix
        free = set(range(len(theta)))
        while free:
            excess = {i: theta[i] - self._clamped(i, theta[i]) for i in free}
            worst = max(free, key=lambda i: excess[i] ** 2 / max(p[i][i], _TINY))
            if excess[worst] == 0.0:
                break
            _shift(theta, p, worst, -excess[worst])
            free.remove(worst)
        return tuple(self._clamped(i, value) for i, value in enumerate(theta))

    def _clamped(self, i: int, value: float) -> float:
        lower, upper = self._bounds[i]
        return min(max(value, lower), upper)


def _shift(theta: list[float], p: Matrix, i: int, by: float) -> None:
    """Conditions N(theta, p) on its component i being theta_i + by, in place."""
    gain = [row[i] / max(p[i][i], _TINY) for row in p]
    row_i = list(p[i])
    for k, g in enumerate(gain):
        theta[k] += g * by
        p[k] = [value - g * r for value, r in zip(p[k], row_i, strict=True)]


class UdCovariance:
    """P = U D U' for n parameters (U unit upper triangular, D diagonal), in plain floats; diagonal at first.

    Bierman, Factorization Methods for Discrete Sequential Estimation (1977), chapter V: D stays positive and
    P symmetric whatever the rounding, without square roots. Up to about ten parameters, plain floats are
    several times faster than numpy.
    """

    def __init__(self, diagonal: Sequence[float]) -> None:
        self._d = list(diagonal)
        self._u: Matrix = [[0.0] * j for j in range(len(self._d))]  # column j of U, above the diagonal

    def project(self, phi: Sequence[float]) -> tuple[list[float], list[float], float]:
        """(f, v, power) with f = U' phi, v = D f and power = phi' P phi."""
        f: list[float] = []
        v: list[float] = []
        d = self._d
        power = 0.0
        for j, column in enumerate(self._u):
            f_j = phi[j]
            for i, u in enumerate(column):
                f_j += u * phi[i]
            v_j = d[j] * f_j
            power += f_j * v_j
            f.append(f_j)
            v.append(v_j)
        return f, v, power

    def correct(self, f: list[float], v: list[float], lam: float) -> tuple[list[float], float]:
        """Sets P to (I - K phi') P / lambda for the phi that gave f and v; returns (P phi, alpha), with P as
        it was before and the gain K = P phi / alpha.

        `v` is overwritten: it becomes P phi.
        """
        d = self._d
        alpha = lam
        for j, column in enumerate(self._u):
            f_j, v_j, before = f[j], v[j], alpha
            alpha += f_j * v_j
            d[j] *= before / (alpha * lam)
            p = f_j / before
            for i, u in enumerate(column):
                k = v[i]
                column[i] = u - k * p
                v[i] = k + u * v_j
        return v, alpha

    def inform(self, i: int, information: float) -> None:
        """Adds to element (i, i) of inv(P): a measurement of parameter i alone."""
        phi = [0.0] * len(self._d)
        phi[i] = information**0.5
        f, v, _ = self.project(phi)
        self.correct(f, v, 1.0)

    @property
    def matrix(self) -> Matrix:
        """P as a list of rows, computed from U and D; exactly symmetric."""
        n = len(self._d)
        u = [[self._u[j][i] if i < j else float(i == j) for j in range(n)] for i in range(n)]
        p = [[0.0] * n for _ in range(n)]
        for i in range(n):
            for j in range(i, n):
                p[i][j] = p[j][i] = sum(u[i][k] * self._d[k] * u[j][k] for k in range(j, n))
        return p
