"""Any contact model in motion: physics at 10 kHz or faster, converted at the stamps of the recording."""

from collections.abc import Callable, Sequence
from math import ceil

import numpy as np

from forefeel.common.causes.model import ContactModel
from forefeel.common.errors import ConfigurationError
from forefeel.common.recording.recording import Array
from forefeel.simulate.motion import MotionPiece

PHYSICS_HZ = 10_000  # least rate of the integration
_CHUNK = 1000  # stamps per stretch of integration: bounds the memory and paces the progress


def integrate(
    model: ContactModel, pieces: Sequence[MotionPiece], progress: Callable[[float], None]
) -> tuple[Array, Array]:
    """Moves the model along the pieces; returns (position m, force N) at all their stamps, each shape (n,).

    From rest at the first stamp, from which the model's time counts; each piece is a new contact. Between two
    stamps lie equal steps of at most 0.1 ms. `progress` gets the stamp reached, in s.

    Raises:
        ConfigurationError: the model gives a force that is not finite.
    """
    runtime = model.runtime()
    origin_s = float(pieces[0].stamps_s[0])
    positions, forces = [], []
    for motion, stamps_s in pieces:
        runtime.reset_contact()
        before_s = float(stamps_s[0])
        for first in range(0, len(stamps_s), _CHUNK):
            t, dt, ends = _steps(before_s, stamps_s[first : first + _CHUNK])
            x, v, a = motion.at(t)
            course = zip(*(c.tolist() for c in (t - origin_s, x, v, a, dt)), strict=True)
            force_n = np.array([runtime.step(*at) for at in course])
            _require_finite(model, force_n, t - origin_s)
            positions.append(x[ends])
            forces.append(force_n[ends])
            before_s = float(t[-1])
            progress(before_s)
    return np.concatenate(positions), np.concatenate(forces)


def _steps(
    before_s: float, stamps_s: Array
) -> tuple[Array, Array, np.ndarray[tuple[int], np.dtype[np.intp]]]:
    """Ends t and lengths dt of the integration steps in s from `before_s` through the stamps, in equal steps
    of at most 0.1 ms from stamp to stamp; and the index of the step that ends at each stamp.
    """
    intervals = np.diff(stamps_s, prepend=before_s)
    counts = [max(1, ceil(interval * PHYSICS_HZ * (1.0 - 1e-9))) for interval in intervals.tolist()]
    parts = np.repeat(np.array(counts), counts)
    ends = np.cumsum(counts) - 1
    nth = np.arange(1, len(parts) + 1) - np.repeat(ends + 1 - np.array(counts), counts)
    dt = np.repeat(intervals, counts) / parts
    t = np.repeat(stamps_s, counts) - (parts - nth) * dt
    return t, dt, ends


def _require_finite(model: ContactModel, forces: Array, t: Array) -> None:
    for index in np.flatnonzero(~np.isfinite(forces))[:1]:
        raise ConfigurationError(
            f"model {model.name!r}: gives {forces[index]} N at {t[index]:g} s, expected a finite force"
        )
