"""Regimes of the motion, and the errors made in each. Pure.

    v(t) = (x(b) - x(a)) / (b - a)                                                                      (1)

is a central difference of the own motion: a and b are the outermost stamps within 25 ms of t, at least the
neighbours of t. At a difference of neighbours alone, one count of an encoder at 1 kHz is no rest any more.

    rest        |v| has at most 1 % of its rms for at least 0.2 s
    onset       up to 0.3 s after a rest
    reversal    up to 0.3 s after v, beyond 1 % of its rms, has another sign than before
    cruise      all else

The first that is true counts, so each sample belongs to exactly one. A gap ends a rest, and no regime reaches
across it.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from forefeel.common.error_size import Floats, error_size
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.evaluation.methods import Mask

REGIMES = "rest", "onset", "reversal", "cruise"
_REST, _ONSET, _REVERSAL, _CRUISE = range(len(REGIMES))
_HALF_SPAN_S = 0.025
_REST_SHARE = 0.01  # of the rms of v
_REST_S = 0.2
_AFTER_S = 0.3  # how long onset and reversal last
_ROUNDING_S = 1e-6  # s, rounding of stamps: 20 periods of 10 ms are 0.2 s

RULE = (
    f"rest: |v| has at most {100 * _REST_SHARE:g} % of its rms for at least {_REST_S:g} s, v being a central "
    f"difference of the own motion over {2e3 * _HALF_SPAN_S:g} ms; onset: {_AFTER_S:g} s after a rest; "
    f"reversal: {_AFTER_S:g} s after a change of the sign of v; cruise: all else. The first that is true "
    "counts."
)

Regimes = NDArray[np.int64]
"""For each sample an index of `REGIMES`."""


@dataclass(frozen=True, slots=True)
class RegimeScore:
    """Errors of the scored samples in one regime.

    Attributes:
        share: of all scored samples.
        zoh_rms_n, forefeel_rms_n: rms of the error; None without a sample, or where forefeel diverged.
    """

    share: float
    zoh_rms_n: float | None = None
    forefeel_rms_n: float | None = None

    @property
    def ratio(self) -> float | None:
        """forefeel's rms over that of zoh; None when either is unknown, or zoh makes no error."""
        if self.forefeel_rms_n is None or not self.zoh_rms_n:
            return None
        return self.forefeel_rms_n / self.zoh_rms_n


def regimes(recording: Recording) -> Regimes:
    """Regime of each sample; no regime reaches across a gap."""
    time_s, pieces = recording.time_s, recording.segments()
    velocity = np.concatenate([_velocity(time_s[piece], recording.position_m[piece]) for piece in pieces])
    slow = np.abs(velocity) <= _REST_SHARE * np.sqrt(np.mean(velocity**2))
    direction = np.where(slow, 0.0, np.sign(velocity))
    return np.concatenate([_regimes(time_s[piece], direction[piece]) for piece in pieces])


def by_regime(
    regime: Regimes, rows: Mask, force_n: Floats, zoh_n: Floats, forefeel_n: Floats | None
) -> Mapping[str, RegimeScore]:
    """Share of the scored samples `rows` and rms errors of zoh and forefeel in each regime, by its name; None
    for a regime without a sample. Arrays have shape (n,).

    Args:
        regime: of each sample, an index of `REGIMES`.
        forefeel_n: None where it diverged.
    """
    scores: dict[str, RegimeScore] = {}
    for number, name in enumerate(REGIMES):
        inside = rows & (regime == number)
        zoh_rms_n, forefeel_rms_n = (
            None if predicted_n is None else error_size(predicted_n[inside], force_n[inside]).rms_n
            for predicted_n in (zoh_n, forefeel_n)
        )
        share = float(np.count_nonzero(inside) / np.count_nonzero(rows))
        scores[name] = RegimeScore(share, zoh_rms_n, forefeel_rms_n)
    return scores


def _velocity(time_s: Floats, x: Floats) -> Floats:
    """Velocity in m/s of a piece without gaps: a central difference over the outermost stamps within 25 ms,
    at least the neighbours; 0 for a single sample, of which no motion is known.
    """
    n = len(time_s)
    if n == 1:
        return np.zeros(1)
    here = np.arange(n)
    reach_s = _HALF_SPAN_S + _ROUNDING_S
    first = np.searchsorted(time_s, time_s - reach_s)
    last = np.searchsorted(time_s, time_s + reach_s, side="right") - 1
    a = np.minimum(first, np.maximum(here - 1, 0))
    b = np.maximum(last, np.minimum(here + 1, n - 1))
    return np.asarray((x[b] - x[a]) / (time_s[b] - time_s[a]))


def _regimes(time_s: Floats, direction: Floats) -> Regimes:
    """Regime of each sample of a piece without gaps, an index of `REGIMES`: rest, else onset (0.3 s after a
    rest), else reversal (0.3 s after the sign changes), else cruise. `direction`: the sign of v, 0 where it
    is slow.
    """
    at_rest = _long_enough(time_s, direction == 0.0)
    regime = np.full(len(time_s), _CRUISE)
    regime[_soon_after(time_s, _turned(direction))] = _REVERSAL
    regime[_soon_after(time_s, at_rest)] = _ONSET
    regime[at_rest] = _REST
    return regime


def _long_enough(time_s: Floats, slow: Mask) -> Mask:
    """Mask of the slow samples in runs of at least 0.2 s."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], slow, [False])).astype(np.int8)))
    first, last = edges[::2], edges[1::2] - 1
    lasting = time_s[last] - time_s[first] >= _REST_S - _ROUNDING_S
    steps = np.zeros(len(slow) + 1, dtype=np.int64)
    steps[first[lasting]] = 1
    steps[last[lasting] + 1] = -1
    return np.cumsum(steps[:-1]) > 0


def _turned(direction: Floats) -> Mask:
    moving = np.flatnonzero(direction)
    turned = np.zeros(len(direction), dtype=np.bool_)
    turned[moving[1:]] = np.diff(direction[moving]) != 0.0
    return turned


def _soon_after(time_s: Floats, event: Mask) -> Mask:
    newest_s = np.maximum.accumulate(np.where(event, time_s, -np.inf))
    return np.asarray(time_s - newest_s <= _AFTER_S + _ROUNDING_S)
