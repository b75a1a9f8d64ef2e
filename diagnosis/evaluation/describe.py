"""What must be said of a recording before its numbers: sampling, gaps, whether its motion tells anything."""

from itertools import pairwise

import numpy as np

from common.error_size import Floats
from common.recording.recording import GAP_S, Recording

_WINDOW_S = 0.5
_MOST = 0.95
_STEADY = 0.05
_SHOWN_GAPS = 5


def notes(recording: Recording) -> tuple[str, ...]:
    """Plain sentences; the last one, where there is one, says that the motion tells nothing."""
    found = (_sampling(recording), _gaps(recording), _motion(recording))
    return tuple(note for note in found if note)


def gap_count(recording: Recording) -> int:
    """How many pauses over 0.1 s there are."""
    return len(recording.segments()) - 1


def _sampling(recording: Recording) -> str:
    period_ms = 1e3 * np.concatenate([np.diff(recording.time_s[piece]) for piece in recording.segments()])
    if not len(period_ms):
        return (
            f"no two samples within {GAP_S:g} s: no motion between samples is known, so expect hold "
            f"({recording.rate_hz:.3g} Hz)"
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
    """Compares the speed over windows of half a second: steady when 95 % of them agree within 5 %, or within
    what the noise of the position does to them.
    """
    speeds, doubt = _window_speeds(recording)
    if not len(speeds):
        return None
    usual = float(np.median(speeds))
    still = float(np.mean(np.abs(speeds) <= doubt))
    steady = float(np.mean(np.abs(speeds - usual) <= _STEADY * abs(usual) + doubt))
    if still >= _MOST:
        return f"position does not move{_share(still)}: motion tells nothing, expect hold"
    if steady >= _MOST:
        return (
            f"position moves at constant speed, {abs(usual) * 1e3:.3g} mm/s{_share(steady)}: "
            "motion tells nothing, expect hold"
        )
    return None


def _share(share: float) -> str:
    return "" if share == 1.0 else f", {share:.0%} of the time"


def _window_speeds(recording: Recording) -> tuple[Floats, float]:
    """(slope of the position over each window of half a second in m/s, 4 sigma of what noise makes of it).

    The noise is what second differences show; a motion that is well sampled hardly enters them.
    """
    speeds: list[float] = []
    wiggles: list[Floats] = []
    samples = max(int(_WINDOW_S * recording.rate_hz), 4)
    for piece in recording.segments():
        time_s, x = recording.time_s[piece], recording.position_m[piece]
        wiggles.append(np.diff(x, 2))
        for start in range(0, len(x) - samples + 1, samples):
            window = slice(start, start + samples)
            late = time_s[window] - time_s[window].mean()
            speeds.append(float(late @ (x[window] - x[start]) / (late @ late)))
    noise_m = float(np.sqrt(np.mean(np.concatenate(wiggles) ** 2) / 6.0)) if speeds else 0.0
    spread_s = samples / recording.rate_hz / np.sqrt(12.0)
    return np.array(speeds), 4.0 * noise_m / (spread_s * np.sqrt(samples)) if speeds else 0.0
