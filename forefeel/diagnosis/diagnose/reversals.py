"""What jumps at reversals: the force where the motion is imposed, the acceleration where a force drives."""

from dataclasses import dataclass

import numpy as np

from forefeel.common.error_size import Floats
from forefeel.diagnosis.diagnose.regression import RecordingRegression

_HALF_S = 0.08
_ORDER = 3
_LEAST = 8
_DRAWS = 500
_OF_FORCE = 0.05


@dataclass(frozen=True, slots=True)
class Jump:
    """`force_n` and `inertia_n`: jumps of the force and of mass times acceleration per change of direction;
    95 % interval of the force's share in their difference; whether it is clearly the acceleration.
    """

    count: int
    force_n: float
    inertia_n: float
    share_low: float
    share_high: float
    of_acceleration: bool


def jump_at_reversals(regression: RecordingRegression) -> Jump | None:
    """Both jumps over all reversals; None where there are too few, or no dry friction.

    Around each reversal force, acceleration and direction, all through the same filter, lose a cubic in time;
    what is left of the first two is regressed on the third. Intervals by drawing reversals.
    """
    signals = regression.signals
    fit = regression.fit({"bias": (), "coulomb_friction": ()})
    mass, friction = float(fit.coefficients[0]), float(fit.of("coulomb_friction")[0])
    direction = regression.block({}, "coulomb_friction", ())[:, 0]
    acceleration, speed, _ = regression.block({}, "", ()).T
    half = max(int(_HALF_S * signals.coarse_rate_hz), _ORDER + 1)
    at = _reversals(regression, speed, direction, half)
    spread = float(np.std(signals.force[signals.rows]))
    if len(at) < _LEAST or friction * regression.sense < _OF_FORCE * spread:
        return None
    rows = np.array(at)[:, None] + np.arange(-half, half + 1)
    s, f, a = (_less_cubic(column[rows]) for column in (direction, signals.force, mass * acceleration))
    sums = np.column_stack([np.sum(s * s, axis=1), np.sum(s * f, axis=1), np.sum(s * a, axis=1)])
    drawn = sums[np.random.default_rng(0).integers(len(at), size=(_DRAWS, len(at)))].sum(axis=1)
    force, inertia = drawn[:, 1] / drawn[:, 0], drawn[:, 2] / drawn[:, 0]
    low, high = np.quantile(force / (force - inertia), (0.025, 0.975))
    of_force, of_inertia = (float(np.sum(sums[:, i]) / np.sum(sums[:, 0])) for i in (1, 2))
    known = 0.2 < (of_force - of_inertia) / friction < 1.6
    certain = abs(of_inertia) > 4.0 * float(np.std(inertia))
    driven = bool(known and certain and low > -0.25 and high < 0.4)
    return Jump(len(at), of_force, of_inertia, float(low), float(high), driven)


def _reversals(regression: RecordingRegression, speed: Floats, direction: Floats, half: int) -> list[int]:
    """Coarse indices where the speed changes its sign and the direction really turns, apart by `half`."""
    found: list[int] = []
    rows = regression.signals.rows
    for i in np.flatnonzero(np.diff(np.sign(speed)) != 0.0):
        around = slice(i - half, i + half + 1)
        apart = not found or i - found[-1] >= half
        inside = i >= half and i + half < len(rows) and bool(rows[around].all())
        if apart and inside and np.ptp(direction[around]) > 0.5:
            found.append(int(i))
    return found


def turns(x: Floats, least: float = 0.1) -> int:
    """How often a position turns by more than that share of its range."""
    return max(len(turning_points(x.tolist(), least * float(np.ptp(x)) if len(x) else 0.0)) - 1, 0)


def turning_points(x: list[float], least: float) -> list[tuple[int, float]]:
    """(index of the extreme, direction from there on) of the first motion and of each reversal after it."""
    turns: list[tuple[int, float]] = []
    low = high = 0
    for i, now in enumerate(x):
        way = turns[-1][1] if turns else 0.0
        high, low = (i if now > x[high] else high), (i if now < x[low] else low)
        if way >= 0.0 and x[high] - now > least:
            turns.append((high, -1.0))
            low = i
        elif way <= 0.0 and now - x[low] > least:
            turns.append((low, 1.0))
            high = i
    return turns


def _less_cubic(windows: Floats) -> Floats:
    tau = np.linspace(-1.0, 1.0, windows.shape[1])
    q, _ = np.linalg.qr(np.vander(tau, _ORDER + 1))
    return np.asarray(windows - (windows @ q) @ q.T)
