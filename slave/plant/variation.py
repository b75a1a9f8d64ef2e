"""The same patient on another day, or another patient: a contact model with other parameters. Pure."""

from collections.abc import Iterator
from dataclasses import replace
from math import pi

import numpy as np

from forefeel.common.causes.model import ContactModel, EffectEntry
from forefeel.common.causes.registry import effect_class

MOST_SPREAD = 0.9
_SHIFT_M = 0.01
"""m, shift of the contact position at a spread of 1."""
_MOST_SHIFT_M = 0.003
# an adult at rest: heart 60 to 100, breath 12 to 20 per minute, which is 25 % about the middle of each
_MOST_RATE_SPREAD = 0.25


def varied(model: ContactModel, spread: float, seed: int) -> ContactModel:
    """The model with each parameter p drawn uniformly from p (1 +- spread), within its bounds.

    The contact position is shifted by up to min(10 mm spread, 3 mm), the frequency of a pulsation (heart,
    breath) changes by up to min(2 spread, 25 %), and its phase is any: no heart waits for the start of a run.

    Args:
        spread: 0 to MOST_SPREAD.
        seed: equal seeds give equal models, bit for bit.
    """
    random = np.random.default_rng(seed)
    effects = (replace(entry, parameters=tuple(_drawn(entry, spread, random))) for entry in model.effects)
    return replace(model, effects=tuple(effects))


def _drawn(entry: EffectEntry, spread: float, random: "np.random.Generator") -> Iterator[tuple[str, float]]:
    values = dict(entry.parameters)
    for parameter in effect_class(entry.effect).parameters:
        value, share = values[parameter.name], random.uniform(-1.0, 1.0)
        match entry.effect, parameter.name:
            case "contact_loss", "contact_position_m":
                value += share * min(_SHIFT_M * spread, _MOST_SHIFT_M)
            case "pulsation", "frequency_hz":
                value *= 1.0 + share * min(2.0 * spread, _MOST_RATE_SPREAD)
            case "position_dependent_friction", "band_m_s":
                pass  # how sharply its sign turns, no property of a vessel
            case "pulsation", "phase_rad":
                value = pi * share
            case _:
                value *= 1.0 + share * spread
        yield parameter.name, min(max(value, parameter.lower), parameter.upper)
