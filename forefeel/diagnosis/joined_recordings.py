"""Several recordings of one bench as one: each behind the last one, with a gap between them.

Nothing is carried across a gap: frictions, plays and relaxations begin anew. Whole recordings are held out.
What has an instant or a phase of its own is not searched, for the recordings share no clock.
"""

from collections.abc import Sequence

import numpy as np

from forefeel.common.causes.candidate import ReadingColumns, base_name
from forefeel.common.causes.catalogue import CANDIDATES
from forefeel.common.errors import RecordingError
from forefeel.common.recording.recording import Recording

_APART_S = 10.0  # s between two recordings: more than any gap within which samples belong together
_ALIKE = 1.1  # ratio of rates that one band and one grid do for


def joined(recordings: Sequence[Recording]) -> tuple[Recording, tuple[float, ...]]:
    """The recordings as one, and when each but the first begins, in s since the start; one stays as it is.

    Raises:
        RecordingError: rates that differ by more than a tenth.
    """
    first, *more = recordings
    if not more:
        return first, ()
    stamps, parts_s, now_s = [], [], 0.0
    for each in recordings:
        if not 1.0 / _ALIKE < each.rate_hz / first.rate_hz < _ALIKE:
            raise RecordingError(
                f"{each.source}: {each.rate_hz:.4g} Hz beside {first.rate_hz:.4g} Hz of {first.source}; "
                f"expected recordings of one rate"
            )
        stamps.append(each.time_s - each.time_s[0] + now_s)
        parts_s.append(now_s - 0.5 * _APART_S)
        now_s = float(stamps[-1][-1]) + _APART_S
    force_n = [each.force_n for each in recordings if each.force_n is not None]
    whole = Recording(
        ", ".join(each.name for each in recordings),
        np.concatenate(stamps),
        np.concatenate([each.position_m for each in recordings]),
        np.concatenate(force_n),
        ", ".join(each.source for each in recordings),
    )
    return whole, tuple(parts_s[1:])


def unclocked() -> list[str]:
    """The causes that are the same in every recording of a bench."""
    clocked = {n for n, each in CANDIDATES.items() if isinstance(each, ReadingColumns) and n != "bias"}
    return [name for name in CANDIDATES if name not in clocked and base_name(name) != "stiffness_change"]
