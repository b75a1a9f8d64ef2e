"""The sign of a velocity as the friction effects use it."""

import numpy as np

from forefeel.common.causes.offline import Array

# m/s, half the width of the linear band; chosen, not measured: a wider one makes slow friction viscous, a
# narrower one lets it chatter where a servo comes to rest
BAND_M_S = 1e-5


def direction(v: float) -> float:
    """sign(v), exact beyond 10 um/s and linear in v inside that band.

    The band keeps friction from chattering where a servo comes to rest, the usual regularisation of Coulomb's
    law (Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30(7), 1994).
    """
    if v >= BAND_M_S:
        return 1.0
    if v <= -BAND_M_S:
        return -1.0
    return v / BAND_M_S


def directions(v: Array) -> Array:
    """`direction` of each velocity, shape (n,)."""
    return np.clip(v / BAND_M_S, -1.0, 1.0)
