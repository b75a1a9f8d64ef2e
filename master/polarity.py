"""Polarity of a handle's motor, from the rendered force and the motion of the hand. Pure."""

import numpy as np

_TICK_S = 1e-3
_TICKS, _ORDER = 100, 4
"""A person reacts after 0.1 s: in so short a time the force that a hand adds is a polynomial of second order,
its motion under it one of fourth."""
_BASIS = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, _TICKS), _ORDER + 1))[0]
_SWING_N = 0.2
_FORGETTING, _LEAST_WINDOWS = 0.9, 5
_LEAST_R, _LEAST_PER_KG = 0.5, 0.25


class PolarityCheck:
    """Detects a motor that pushes the hand along where it should resist.

    A hand of mass m under a force f that resists moves by m x'' = g - f. In each window of 0.1 s x and p, the
    double integral of f, are freed of what a smooth force g of the hand may have made, polynomials of fourth
    order. Of the rest, over the last ten windows in which that of f swings by 0.2 N, x = -p / m: r, the
    correlation of both, is near -1, with a motor wired the other way near +1. A force as smooth as that of a
    hand says nothing.

    It is told from r > 0.5 in five windows, as of a hand lighter than 4 kg. With relaxed, loose, tapping,
    shaking, stiff and hard pushing hands at walls of 200 to 8000 N/m r stays below 0.35. A reversed motor is
    told late or not at all at a contact softer than the arm, and in a hand as stiff as the wall: both keep
    it from running away.
    """

    def __init__(self) -> None:
        self._positions_m, self._forces_n = list[float](), list[float]()
        self._sums = np.zeros(3)
        self._windows = 0

    def is_reversed(self, position_m: float, force_n: float) -> bool:
        """Adds position and force of a tick. True, for a reversed motor, only at the end of a window of 100
        ticks, from the fifth on in which the force, freed of its smooth part, swings by 0.2 N, if the motion
        goes with the force. Else False.
        """
        self._positions_m.append(position_m)
        self._forces_n.append(force_n)
        if len(self._forces_n) < _TICKS:
            return False
        moved_m, force = np.array(self._positions_m), np.array(self._forces_n)
        self._positions_m.clear()
        self._forces_n.clear()
        if np.ptp(force - _BASIS @ (_BASIS.T @ force)) < _SWING_N:
            return False
        pushed = np.cumsum(np.cumsum(force)) * _TICK_S**2
        moved_m, pushed = (signal - _BASIS @ (_BASIS.T @ signal) for signal in (moved_m, pushed))
        self._sums = _FORGETTING * self._sums + (moved_m @ pushed, moved_m @ moved_m, pushed @ pushed)
        self._windows += 1
        both, motion, push = self._sums
        along = both > _LEAST_R * np.sqrt(motion * push) and both > _LEAST_PER_KG * push
        return bool(along) and self._windows >= _LEAST_WINDOWS
