"""A recording with what was hidden in it."""

from dataclasses import dataclass

import numpy as np

from tests.hidden_effects.generator.motion import Motion
from tests.hidden_effects.generator.parts import Base, Part, Place, Signal, transmit
from tests.hidden_effects.generator.scan import Array


@dataclass(frozen=True)
class Noise:
    """Of the reading: first-order autoregressive and white; and the step of the position's encoder."""

    rms_n: float
    corner_hz: float
    white_n: float
    encoder_m: float


@dataclass(frozen=True)
class Truth:
    """What was hidden, with everything that was drawn. `shares` in the order of `parts`."""

    parts: tuple[Part, ...]
    shares: tuple[float, ...]
    motion: str
    duration_s: float
    rate_hz: float
    base: Base
    noise: Noise

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(part.form.name for part in self.parts)

    @property
    def labels(self) -> tuple[str, ...]:
        return tuple(part.form.label for part in self.parts)

    @property
    def parameters(self) -> dict[str, dict[str, float]]:
        """Those with a meaning in the vocabulary, by effect."""
        return {part.form.name: part.parameters for part in self.parts}


@dataclass(frozen=True)
class Hidden:
    """`time_s`, `position_m`, `force_n` are the recording: all that a diagnosis may see."""

    time_s: Array
    position_m: Array
    force_n: Array
    truth: Truth
    stage: Motion
    """On the fine grid, before the encoder."""


def reading(motion: Motion, base: Base, parts: tuple[Part, ...], time_s: Array, noise: Array) -> Array:
    """The force at the record's instants: transmitted, sampled, noise added, then what the reading does."""
    force = np.interp(time_s, motion.t, transmit(motion, base, parts)) + noise
    zeros = np.zeros_like(time_s)
    signal = Signal(base, time_s, zeros, zeros, zeros, force)
    for part in sorted(parts, key=lambda part: part.form.name, reverse=True):
        if part.form.place is Place.READING:
            part.form.act(signal, part.values)
    return signal.force
