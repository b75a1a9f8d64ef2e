"""Asks about a recording of travel, speed, force, stiffness or rate that no bench has: a unit may be wrong.

Rad and N m, or V of an electronic oscillator, may stand for m and N. So the bounds are far out: millimetres
are seen by travels over 15 mm or by soft contacts, mN by forces over 10 N.
"""

from dataclasses import dataclass
from math import log10

import numpy as np

from forefeel.common.events.text import quantity, shown_unit
from forefeel.common.recording.recording import Recording
from forefeel.common.recording.units import Quantity

_RATES_HZ = (9.9, 150e3)
"""Below 10 Hz, up to rounding, no band is left to diagnose in; above is no load cell."""
_TRAVELS_M = (1e-8, 15.0)
"""From the noise of a laboratory's interferometer to two turns of a robot's joint, in rad, with room."""
_FASTEST_M_S = 200.0  # mean: linear motors reach 5 m/s, a spindle 1,000 rad/s does not reverse
_FORCES_N = (1e-7, 1e4)  # from the resolution of a balance to the tensile machine of a laboratory
_STIFFEST_N_M = 1e8  # presliding of a machine tool; a load cell of 10 kN gives way by 50 um
_SOFTEST_N_M = 0.02
"""Over more than _LONG_M. A cardiac catheter has some 1 N/m, an instrument's spindle .14 N m/rad."""
_LONG_M = 1.0
_USUAL_HZ, _USUAL_M = 400.0, 0.1


@dataclass(frozen=True, slots=True)
class Question:
    """`text`: what is doubted, such as `spans 20 m`. `factor`: on the quantity, which would make it usual."""

    quantity: Quantity
    text: str
    factor: float


def question(recording: Recording) -> Question | None:
    """Question about the unit of time, position or force, the first that is implausible, to be asked before a
    diagnosis. None where all is usual; also where position or force is missing or constant, if the rate is
    usual.
    """
    rate_hz, travel_m = recording.rate_hz, float(np.ptp(recording.position_m))
    if not _RATES_HZ[0] <= rate_hz <= _RATES_HZ[1]:
        return Question("time", f"is sampled at {rate_hz:.3g} Hz", _thousands(rate_hz / _USUAL_HZ))
    force = recording.force_n
    force_n = 0.0 if force is None else float(np.subtract(*np.quantile(force, (0.995, 0.005))))
    if travel_m == 0.0 or force_n == 0.0:  # refused for that
        return None
    speed_m_s = float(np.sum(np.abs(np.diff(recording.position_m)))) / recording.duration_s
    return _position_question(travel_m, speed_m_s, force_n / travel_m) or _force_question(
        force_n, force_n / travel_m
    )


def _position_question(travel_m: float, speed_m_s: float, stiffness_n_m: float) -> Question | None:
    """Question whether the position's unit is off: span below 10 nm or over 15 m (over 1 m at a very soft
    contact), or mean speed over 200 m/s; its factor is a power of 1000. None: plausible.
    """
    spans, usual = f"spans {quantity(travel_m, 'm')}", _thousands(_USUAL_M / travel_m)
    if travel_m < _TRAVELS_M[0]:
        return Question("position", spans, usual)
    if travel_m > _TRAVELS_M[1] or (travel_m > _LONG_M and stiffness_n_m < _SOFTEST_N_M):
        return Question("position", spans, min(usual, 1e-3))
    if speed_m_s > _FASTEST_M_S:
        return Question("position", f"moves at {speed_m_s:.3g} m/s", min(usual, 1e-3))
    return None


def _force_question(force_n: float, stiffness_n_m: float) -> Question | None:
    """Question whether the force's unit is off by 1000: `force_n`, its span, below 1e-7 N (factor 1e3) or
    above 10 kN, or a contact stiffer than 1e8 N/m (factor 1e-3). None: plausible.
    """
    spans = f"spans {quantity(force_n, 'N')}"
    if force_n < _FORCES_N[0]:
        return Question("force", spans, 1e3)
    if force_n > _FORCES_N[1]:
        return Question("force", spans, 1e-3)
    if stiffness_n_m > _STIFFEST_N_M:
        return Question("force", f"{spans}, {stiffness_n_m:.3g} {shown_unit('N/m')}", 1e-3)
    return None


def _thousands(ratio: float) -> float:
    """The nearest power of a thousand."""
    return float(1000.0 ** round(log10(ratio) / 3.0))
