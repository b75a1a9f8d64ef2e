"""What must be said of a recording before its numbers: sampling, gaps, whether its motion tells anything."""

from itertools import pairwise

import numpy as np

from forefeel.common.error_size import Floats
from forefeel.common.estimation.state_filter import GAP_S
from forefeel.common.recording.recording import Recording

# s, length of a window
_WINDOW_S = 0.5
# share of the windows at rest, or at one speed, from which it is noted
_NOTED_SHARE = 0.95
# share of the usual speed by which a steady window may differ
_STEADY_SHARE = 0.05
_SHOWN_GAPS = 5  # gaps that are listed


def notes(recording: Recording) -> tuple[str, ...]:
    """Plain sentences; the last one, where there is one, says that the motion tells nothing."""
    found = (_sampling(recording), _gaps(recording), _motion(recording))
    return tuple(note for note in found if note)


def _sampling(recording: Recording) -> str:
    period_ms = 1e3 * np.concatenate([np.diff(recording.time_s[piece]) for piece in recording.segments()])
    if not len(period_ms):
        return (
            f"no two samples within {GAP_S:g} s: no motion between samples is known, so expect the "
            f"zero-order hold ({recording.rate_hz:.3g} Hz)"
        )
    low, middle, high = np.quantile(period_ms, (0.01, 0.5, 0.99)).tolist()
    spread = (high - low) / middle
    if spread < 0.01:
        return f"sampled uniformly at {recording.rate_hz:.4g} Hz"
    return (
        f"not sampled uniformly: {recording.rate_hz:.4g} Hz in the median, period {low:.3g} to {high:.3g} ms "
        f"(1 % to 99 %), at most {period_ms.max():.3g} ms; taken as it is"
    )


def _gaps(recording: Recording) -> str | None:
    pieces, time_s = recording.segments(), recording.time_s
    found = [(time_s[a.stop - 1], time_s[b.start]) for a, b in pairwise(pieces)]
    if not found:
        return None
    shown = ", ".join(
        f"{end - start:.2f} s at {start - time_s[0]:.2f} s" for start, end in found[:_SHOWN_GAPS]
    )
    more = f" and {len(found) - _SHOWN_GAPS} more" if len(found) > _SHOWN_GAPS else ""
    plural = "gap" if len(found) == 1 else "gaps"
    return f"{len(found)} {plural} over {GAP_S:g} s, not bridged: {shown}{more}"


def _motion(recording: Recording) -> str | None:
    """Compares lines through windows of half a second: steady when 95 % of them are straight and agree within
    5 %, or within what the noise of the position does to them.
    """
    samples, pieces = max(int(_WINDOW_S * recording.rate_hz), 4), recording.segments()
    time_s, x = (
        np.concatenate([_windows(column[piece], samples) for piece in pieces])
        for column in (recording.time_s, recording.position_m)
    )
    if not len(x):
        return None
    late_s, moved_m = time_s - time_s.mean(axis=1, keepdims=True), x - x[:, :1]  # exactly zero at rest
    off_m = moved_m - moved_m.mean(axis=1, keepdims=True)
    speeds = np.sum(late_s * off_m, axis=1) / np.sum(late_s**2, axis=1)
    crooked_m = np.sqrt(np.mean((off_m - speeds[:, None] * late_s) ** 2, axis=1))
    # a motion that is well sampled hardly enters second differences
    wiggles_m = np.concatenate([np.diff(recording.position_m[piece], 2) for piece in pieces])
    noise_m = float(np.sqrt(np.mean(wiggles_m**2) / 6.0))
    doubt = 4.0 * noise_m * float(np.sqrt(12.0 / samples)) * recording.rate_hz / samples  # of a line's slope
    usual = abs(float(np.median(speeds)))
    straight = crooked_m <= 3.0 * noise_m + _STEADY_SHARE * usual * _WINDOW_S
    still = float(np.mean(straight & (np.abs(speeds) <= doubt)))
    steady = float(np.mean(straight & (np.abs(speeds - np.median(speeds)) <= _STEADY_SHARE * usual + doubt)))
    if still >= _NOTED_SHARE:
        return f"position does not move{_share(still)}: motion tells nothing, expect the zero-order hold"
    if steady >= _NOTED_SHARE:
        return (
            f"position moves at constant speed, {usual * 1e3:.3g} mm/s{_share(steady)}: "
            "motion tells nothing, expect the zero-order hold"
        )
    return None


def _windows(values: Floats, samples: int) -> Floats:
    """Shape (n, samples); what is left at the end is not looked at."""
    return values[: len(values) // samples * samples].reshape(-1, samples)


def _share(share: float) -> str:
    return "" if share == 1.0 else f", {100 * share:.3g} % of the time"
