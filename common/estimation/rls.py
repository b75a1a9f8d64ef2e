"""Recursive least squares that survives hold, collinear motion and changes of the tissue.

Letters of the paper: regressor phi, parameters theta, covariance P (in units of the noise variance), gain K,
innovation e (a priori), forgetting factor lambda. One accepted sample is the paper's

    (9)   K = P phi / (lambda + phi' P phi)
    (10)  P = (I - K phi') P / lambda
    (11)  e = y - phi' theta
    (12)  theta = theta + K e

on the factors of P = U D U' (see `ud`). What is added to the paper:

- lambda = exp(-dt / memory_s): the memory is in seconds, whatever the rate, and dt may vary.
- Information gate: a sample with phi' P phi <= 1 - lambda brings less than forgetting takes; theta, P stay.
- Floor of information: forgetting returns to the prior P0, not to infinity:
  `inv(P) = lambda inv(P) + (1 - lambda) inv(P0) + phi phi'` (Salgado, Goodwin and Middleton, Int. J. Control
  47, 1988). The gate alone does not stop wind-up when the motion is collinear (pure sine): the excited
  directions keep it open. The middle term is a measurement "theta_i is what it is", so theta is not pulled.
- Kick: innovations far above the noise for longer than `kick_after_s` mean another tissue: one sample's worth
  of prior uncertainty is added to P (the self-perturbing term of Park and Jun, Electronics Letters 28, 1992),
  within tr(P0).
- Scaling: U D U' is indifferent to a diagonal scaling of phi, so scales enter through P0 alone.
- Reported parameters obey physical bounds, see `parameters`.
"""

from collections.abc import Sequence
from math import exp, inf, isfinite

from forefeel.common.estimation.ud import Matrix, UdCovariance

_TOP_UP_AT = 0.02
"""Forgotten fraction after which the prior's information is topped up: seldom, yet at most 2 % below it."""

_SURPRISE = 16.0
"""e^2 over its expected variance above which a sample is surprising (4 sigma)."""

_WARM_UP = 100
"""Samples before the noise is measured, and again before anything is surprising."""

_FEWEST_SURPRISES = 5
"""Samples that a kick takes at least, however slow the stream."""

_ABSURD = 1e12
"""phi' P phi above which a regressor is an error of its source: it would outweigh all later samples."""

_TINY = 1e-300
"""Stands for a variance that rounding has made zero."""

_LEAST_LAMBDA = 0.01
"""Keeps lambda above zero when dt is many memories long."""


class RecursiveLeastSquares:
    """Gated, bounded, exponentially forgetting least squares for n linear parameters.

    Args:
        scales: typical magnitude of each regressor, > 0.
        memory_s: time constant of forgetting in s; `math.inf` never forgets (lambda = 1, gate open).
        prior: theta before the first sample; zeros by default (8).
        prior_variance: P0 is diagonal with prior_variance / scales_i^2, in units of the noise variance.
        bounds: (lower, upper) of each reported parameter; none by default.
        noise_floor: standard deviation of y below which nothing is surprising; y's unit.
        kick_after_s: how long innovations must be surprising before P is inflated; `math.inf` never kicks.

    Attributes:
        updates: samples accepted since the last reset. gated: samples without information.
        refused: samples that are not finite, or absurd.
        resets: returns to the prior because the state was not finite. kicks: inflations of P.
        noise_variance: running variance of e / sqrt(1 + phi' P phi), robust to outliers; y's unit squared.
        prior_diagonal: diagonal of P0.

    Raises:
        ValueError: lengths differ, or a value out of its range.
    """

    def __init__(
        self,
        scales: Sequence[float],
        memory_s: float,
        *,
        prior: Sequence[float] | None = None,
        prior_variance: float = 100.0,
        bounds: Sequence[tuple[float, float]] | None = None,
        noise_floor: float = 0.0,
        kick_after_s: float = 0.05,
    ) -> None:
        n = len(scales)
        self.scales = tuple(scales)
        self._prior = tuple(prior) if prior is not None else (0.0,) * n
        self._bounds = tuple(bounds) if bounds is not None else ((-inf, inf),) * n
        if not n == len(self._prior) == len(self._bounds):
            raise ValueError(
                f"{n} scales, {len(self._prior)} prior values, {len(self._bounds)} bounds: expected equal"
            )
        for i, scale in enumerate(scales):
            _require_positive(f"scales[{i}]", scale, finite=True)
        _require_positive("prior_variance", prior_variance, finite=True)
        _require_positive("memory_s", memory_s)
        _require_positive("kick_after_s", kick_after_s)
        self.prior_diagonal = tuple(prior_variance / (s * s) for s in scales)
        self._memory_s = memory_s
        self._prior_variance = prior_variance
        self._noise_floor_2 = noise_floor * noise_floor
        self._kick_after_s = kick_after_s
        self.gated = self.refused = self.resets = self.kicks = 0
        self.reset()

    def reset(self) -> None:
        """Back to the prior; all counters but `updates` go on."""
        self.updates = 0
        self._theta = list(self._prior)
        self._p = UdCovariance(self.prior_diagonal)
        self._forgotten = 0.0
        self._surprised_s = 0.0
        self._seen = 0
        self.noise_variance = self._noise_floor_2

    def update(self, phi: Sequence[float], y: float, dt: float) -> float | None:
        """One sample, dt seconds after the last; returns the innovation e (11), or None when it was refused.

        The same calls on the same start give the same floats.
        """
        e = y
        for i, theta in enumerate(self._theta):
            e -= phi[i] * theta
        f, v, power = self._p.project(phi)
        # NaN and infinity anywhere in phi, y, dt or the state, and what overflows on the way, fail these
        # comparisons.
        if not (e * e < inf and power < _ABSURD and 0.0 <= dt < inf):
            self._refuse()
            return None
        self._watch(e * e / (1.0 + power), dt)
        if self._surprised_s > self._kick_after_s:
            self._kick()
            f, v, power = self._p.project(phi)
        lam = max(exp(-dt / self._memory_s), _LEAST_LAMBDA)
        if power > 1.0 - lam:
            self._correct(f, v, lam, e)
        else:
            self.gated += 1
        return e

    def _correct(self, f: list[float], v: list[float], lam: float, e: float) -> None:
        """Equations (9), (10), (12), then the floor of information."""
        p_phi, alpha = self._p.correct(f, v, lam)
        step = e / alpha
        theta = self._theta
        for i, k in enumerate(p_phi):
            theta[i] += k * step
        self.updates += 1
        self._forgotten += 1.0 - lam
        if self._forgotten >= _TOP_UP_AT:
            for i, variance in enumerate(self.prior_diagonal):
                self._p.inform(i, self._forgotten / variance)
            self._forgotten = 0.0

    def _refuse(self) -> None:
        """Counts the sample; a state that is itself not finite goes back to the prior."""
        self.refused += 1
        if not isfinite(sum(self._theta) + sum(map(sum, self._p.matrix))):
            self.resets += 1
            self.reset()

    def _watch(self, e_2: float, dt: float) -> None:
        """Tracks the noise variance and how long the innovation has been far above it."""
        self._seen += 1
        count = self._seen - _WARM_UP
        if count <= 0:
            return
        limit = _SURPRISE * max(self.noise_variance, self._noise_floor_2) if count > _WARM_UP else inf
        if e_2 > limit:
            self._surprised_s += min(dt, self._kick_after_s / _FEWEST_SURPRISES)
            # Clipped: an outlier or another tissue is no noise; if it lasts, the variance grows in time.
            e_2 = limit
        elif self._surprised_s > 0.0:
            self._surprised_s = max(self._surprised_s - dt, 0.0)
        rate = max(dt / (dt + self._memory_s), 1.0 / count)
        self.noise_variance += rate * (e_2 - self.noise_variance)

    def _kick(self) -> None:
        """P + diag(1 / scales^2), shrunk as a whole where its scaled trace would pass that of P0."""
        p = self._p.matrix
        trace = 0.0
        for i, scale in enumerate(self.scales):
            p[i][i] += 1.0 / (scale * scale)
            trace += p[i][i] * scale * scale
        shrink = min(1.0, len(p) * self._prior_variance / trace)
        self._p = UdCovariance.factorised([[shrink * value for value in row] for row in p])
        self._surprised_s = 0.0
        self.kicks += 1

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


def _require_positive(name: str, value: float, finite: bool = False) -> None:
    if not value > 0.0 or (finite and value == inf):
        raise ValueError(f"{name} = {value!r}: expected a positive number")


def _shift(theta: list[float], p: Matrix, i: int, by: float) -> None:
    """Conditions N(theta, p) on its component i being theta_i + by, in place."""
    gain = [row[i] / max(p[i][i], _TINY) for row in p]
    row_i = list(p[i])
    for k, g in enumerate(gain):
        theta[k] += g * by
        p[k] = [value - g * r for value, r in zip(p[k], row_i, strict=True)]
