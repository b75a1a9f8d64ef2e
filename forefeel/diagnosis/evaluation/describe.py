"""Notes on a recording that belong before its numbers: sampling and gaps."""

from itertools import pairwise

import numpy as np

from forefeel.common.estimation.state_filter import GAP_S
from forefeel.common.recording.recording import Recording

_SHOWN_GAPS = 5  # gaps that are listed


def notes(recording: Recording) -> tuple[str, ...]:
    """Sentences on the sampling and, if there are any, on the gaps."""
    return _sampling(recording), *_gaps(recording)


def _sampling(recording: Recording) -> str:
    """Sentence on rate and evenness of the stamps."""
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


def _gaps(recording: Recording) -> list[str]:
    """One sentence that counts the gaps and lists the first five; none without gaps."""
    pieces, time_s = recording.segments(), recording.time_s
    gaps = [(time_s[a.stop - 1], time_s[b.start]) for a, b in pairwise(pieces)]
    if not gaps:
        return []
    shown = ", ".join(
        f"{end - start:.2f} s at {start - time_s[0]:.2f} s" for start, end in gaps[:_SHOWN_GAPS]
    )
    more = f" and {len(gaps) - _SHOWN_GAPS} more" if len(gaps) > _SHOWN_GAPS else ""
    plural = "gap" if len(gaps) == 1 else "gaps"
    return [f"{len(gaps)} {plural} over {GAP_S:g} s, not bridged: {shown}{more}"]
