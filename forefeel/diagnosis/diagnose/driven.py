"""Whether the force drives the motion, or the motion is imposed and the force its answer.

The regression takes the motion as given. Where a force drives a free body, or a controller turns what it
measures into a force, the residual acts back on the motion and the parameters lean (Soderstrom and Stoica,
System Identification, 1989, chapter 10; Gautier and Poignet, Control Engineering Practice 9, 2001). Four
signs, each of which tells cause from effect by what the cause can not know:

- resonance: the motion has the resonance of mass and spring, the force has nothing there. A cause is not
  shaped by what it passes through (Shajarisales, Janzing, Schoelkopf and Besserve, ICML 2015).
- broad band: over three octaves the force's spectrum is simple (a power law) and the motion's is not, or both
  go on to where no stage is moved.
- active: where they cohere the force gives energy at several frequencies. No contact does, a controller does.
- reversal: at reversals the acceleration jumps by the friction, not the force.

A smooth force on a well damped body shows none of them: it can not be told from an imposed motion.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, rfft
from scipy.signal import csd, periodogram, welch

from forefeel.common.error_size import Floats
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.diagnose.analysis import Analysis
from forefeel.diagnosis.diagnose.band import longest_piece
from forefeel.diagnosis.diagnose.forward import even, forward_rmse
from forefeel.diagnosis.diagnose.regression import ModelFit, RecordingRegression, alignment
from forefeel.diagnosis.diagnose.reversals import Jump, jump_at_reversals
from forefeel.diagnosis.diagnose.verdict import Diagnosis

FLAG = "motion_driven_by_force"

_WINDOW_S = 4.0
_LEAST_SAMPLES = 600
_WINDOW = "blackmanharris"
_PER_OCTAVE = 8
_FASTEST_STAGE_HZ = 20.0
"""No hand and no insertion stage is moved with an even acceleration beyond this."""


@dataclass(frozen=True, slots=True, eq=False)
class Bands:
    """Spectra of a stretch in narrow bands: frequency in Hz, power of x and f, their coherence, f over x,
    standard deviation of its phase in rad.
    """

    frequency_hz: Floats
    motion: Floats
    force: Floats
    coherence: Floats
    transfer: NDArray[np.complex128]
    phase_sd: Floats

    def where(self, rows: NDArray[np.bool_]) -> "Bands":
        """Some of them."""
        return Bands(
            self.frequency_hz[rows], self.motion[rows], self.force[rows], self.coherence[rows],
            self.transfer[rows], self.phase_sd[rows],
        )  # fmt: skip


def force_driven_excitation(
    recording: Recording, force_n: Floats, regression: RecordingRegression, fit: ModelFit
) -> tuple[str, ...]:
    """What speaks for a motion that the force drives, in words; empty: nothing does.

    Args:
        recording: position and stamps.
        force_n: cleaned, same stamps.
        regression, fit: of that recording.
    """
    piece = longest_piece(recording)
    if piece.stop - piece.start < _LEAST_SAMPLES:
        return ()
    period_s, (x, f) = even(recording.time_s[piece], recording.position_m[piece], force_n[piece])
    whole = bands(x, f, period_s)
    linear_n = f - _bent_n(regression, fit, recording.time_s[piece][0] + period_s * np.arange(len(f)))
    found = (
        _resonance(whole),
        _broad_band(whole),
        _active(whole, bands(x, linear_n, period_s), fit),
        _reversal(jump_at_reversals(regression)),
    )
    return tuple(words for words in found if words is not None)


def with_driving(found: Diagnosis, analysis: Analysis) -> Diagnosis:
    """With flag, words and forward simulation where the force drives the motion; else as it is."""
    force_n = analysis.cleaned.force_n
    signs = force_driven_excitation(analysis.recording, force_n, analysis.regression, analysis.fit)
    if not signs:
        return found
    words = (*found.words, *lowered_trust(signs))
    return replace(found, flags=(*found.flags, FLAG), words=words, forward_rmse=forward_rmse(analysis, True))


def lowered_trust(signs: tuple[str, ...]) -> tuple[str, ...]:
    """What a reader is told beside the flag; nothing without signs."""
    if not signs:
        return ()
    return (
        f"The motion seems to be driven by the force: {'; '.join(signs)}.",
        "What the model leaves then acts back on the motion: trust the names less than on a log whose motion "
        "was imposed, and the intervals as too narrow; the forward simulation is the better test.",
    )


def bands(x: Floats, f: Floats, period_s: float) -> Bands:
    """Power from one periodogram, which resolves a sweep; the rest by Welch; in eighths of an octave."""
    rate, count = 1.0 / period_s, int(min(len(x) // 6, _WINDOW_S / period_s))
    frequency, cross = csd(x, f, rate, _WINDOW, nperseg=count, detrend="linear")
    motion, force = (welch(y, rate, _WINDOW, nperseg=count, detrend="linear")[1] for y in (x, f))
    fine_hz = np.arange(len(x) // 2 + 1) * rate / len(x)
    fine = [periodogram(y, rate, ("tukey", 0.1), detrend="linear")[1] for y in (x, f)]
    number, fine_number = (_band_numbers(each, frequency[3]) for each in (frequency, fine_hz))
    rows = []
    for k in np.unique(number[(number >= 0) & (frequency < 0.95 * frequency[-1])]):
        at = number == k
        middle = np.mean(frequency[at])
        coherence = np.mean(np.abs(cross[at]) ** 2 / np.maximum(motion[at] * force[at], 1e-300))
        averages = 1.8 * len(x) / count * max(1.0, np.count_nonzero(at) / 3.0)
        sd = np.sqrt((1.0 - coherence) / (2.0 * max(coherence, 1e-9) * averages))
        power = [np.mean(p[fine_number == k]) + 1e-300 for p in fine]
        turned = np.mean(cross[at] / frequency[at]) * middle
        rows.append((middle, *power, coherence, turned / np.mean(motion[at] + 1e-300), sd))
    columns = np.array(rows, dtype=np.complex128).T
    real = [np.asarray(c.real, dtype=np.float64) for c in columns]
    return Bands(real[0], real[1], real[2], real[3], columns[4], real[5])


def _band_numbers(frequency_hz: Floats, first_hz: float) -> NDArray[np.int64]:
    octaves = np.log2(np.maximum(frequency_hz, 1e-9) / first_hz)
    return np.asarray(np.floor(_PER_OCTAVE * octaves), dtype=np.int64)


def _resonance(every: Bands) -> str | None:
    """log power of the speed = slow curve - beta log |impedance|^2: beta is 1 when the force is the cause."""
    b = every.where(_excited(every, 0.7))
    if len(b.coherence) < 12 or b.frequency_hz[-1] < 3.0 * b.frequency_hz[0]:
        return None
    w = 2.0 * np.pi * b.frequency_hz
    u = np.log(w) - np.mean(np.log(w))
    slow = np.column_stack([np.ones_like(u), u, u * u])
    speed, impedance = (
        _less(slow, y) for y in (np.log(b.motion * w * w), 2.0 * np.log(np.abs(b.transfer) / w))
    )
    beta = -float(impedance @ speed / (impedance @ impedance))
    left = speed + beta * impedance
    error = float(np.sqrt(left @ left / (len(u) - 4) / (impedance @ impedance)))
    peaked, even_force = np.std(impedance) > 0.25, np.std(speed + impedance) < 0.5 * np.std(speed)
    if not (peaked and even_force and abs(beta - 1.0) < 0.3 and error < 0.12):
        return None
    at = b.frequency_hz[int(np.argmin(impedance))]
    return f"the motion has a resonance near {at:.3g} Hz where the force has none"


def _broad_band(every: Bands) -> str | None:
    """A force that is a straight line in the doubly logarithmic spectrum while the motion bends."""
    coherent = _excited(every, 0.8)
    if np.count_nonzero(coherent) < 16:
        return None
    top = every.frequency_hz[coherent][-1]
    b = every.where((every.frequency_hz <= top) & (every.frequency_hz >= top / 8.0))
    if top < 10.0 or np.min(b.coherence) < 0.6:
        return None
    u = np.log(b.frequency_hz)
    line = np.column_stack([np.ones_like(u), u])
    scatter = [float(np.std(_less(line, np.log(power)))) for power in (b.force, b.motion)]
    slope, fall = (float(np.polyfit(u, np.log(power), 1)[0]) for power in (b.force, b.motion))
    if not -2.2 < slope < 0.6 or scatter[0] > 0.3:
        return None
    bent = scatter[1] > max(0.3, 2.0 * scatter[0])
    beyond_a_stage = top > _FASTEST_STAGE_HZ and fall - slope < -2.5
    if not (bent or beyond_a_stage):
        return None
    return f"up to {top:.3g} Hz the force's spectrum is a straight line, the motion's is bent by its inertia"


def _active(every: Bands, linear: Bands, fit: ModelFit) -> str | None:
    """Power that the force gives at frequencies where both cohere, with what bends taken out and without.

    Likewise with a named delay, lag or fixture taken out and without: neither a late force nor a wrong name
    for one is a controller.
    """
    late = alignment(2.0 * np.pi * every.frequency_hz, fit.model)
    giving = np.ones(len(every.coherence), dtype=np.bool_)
    for b in (every, linear):
        for transfer in (b.transfer, b.transfer if late is None else b.transfer / late):
            taken = np.imag(transfer) / np.maximum(np.abs(transfer), 1e-300)
            giving &= (b.coherence > 0.9) & (taken + 4.0 * b.phase_sd < -0.03)
    if np.count_nonzero(giving) < 3:
        return None
    low, high = every.frequency_hz[giving][[0, -1]]
    return (
        f"between {low:.3g} and {high:.3g} Hz the force feeds the motion, as a controller does and no contact"
    )


def _reversal(jump: Jump | None) -> str | None:
    if jump is None or not jump.of_acceleration:
        return None
    return f"at {jump.count} reversals the acceleration jumps by the dry friction, the force does not"


def _excited(every: Bands, least: float) -> NDArray[np.bool_]:
    """Bands of at least that coherence, without the topmost, where an excitation breaks off."""
    rows = np.asarray(every.coherence > least)
    rows[np.flatnonzero(rows)[-1:]] = False
    return rows


def _bent_n(regression: RecordingRegression, fit: ModelFit, time_s: Floats) -> Floats:
    """What the fit explains beside mass, damper and spring, in N at these stamps."""
    signals = regression.signals
    linear = regression.block(fit.model, "", ()) @ fit.of("")
    bent = regression.predicted(fit) - linear
    total = np.zeros(len(time_s))
    for grid, piece in zip(signals.pieces, signals.piecewise(fine=False), strict=True):
        fine = irfft(rfft(bent[piece]), grid.padded) * (grid.padded / grid.coarse)
        t = signals.origin_s + signals.t[piece.start] + grid.period_s * np.arange(grid.samples)
        inside = (time_s >= t[0] - 1e-9) & (time_s <= t[-1] + 1e-9)
        total[inside] = np.interp(time_s[inside], t, fine[: grid.samples])
    return total


def _less(columns: Floats, values: Floats) -> Floats:
    weights, *_ = np.linalg.lstsq(columns, values, rcond=None)
    return np.asarray(values - columns @ weights)
