"""A load cell that answers with the force of a recording."""

from bisect import bisect_left
from collections.abc import Sequence
from math import inf

from forefeel.common.clock import Clock
from forefeel.common.errors import RecordingError
from forefeel.common.estimation.state_filter import GAP_S
from forefeel.common.messages import MOST_FORCE_N
from forefeel.common.recording.loading import load_recording
from forefeel.devices.simulated.settings import RecordedLoadCellSettings
from forefeel.slave.load_cell import LoadCellReading

_NOTHING = LoadCellReading(0.0, 0, False)


class RecordedLoadCell:
    """Load-cell port on recorded (time, force) pairs, linear between samples, never across a gap.

    Args:
        time_s: sample times in s, strictly increasing.
        force_n: force at each, in N.

    Raises:
        RecordingError: a force that no message carries.
    """

    def __init__(self, time_s: Sequence[float], force_n: Sequence[float]) -> None:
        self.full_scale_n = max(map(abs, force_n))
        if self.full_scale_n > MOST_FORCE_N:
            raise RecordingError(f"{self.full_scale_n:g} N: expected at most {MOST_FORCE_N:g} N")
        self._time_s, self._force_n = time_s, force_n

    stale_s = inf

    def open(self) -> None: ...

    def close(self) -> None: ...

    def rearm(self) -> None: ...

    def read(self, now_ns: int, recording_time_s: float | None) -> tuple[LoadCellReading]:
        """The recorded force at `recording_time_s`, whatever the time is now."""
        return (self._at(recording_time_s),)

    def _at(self, recording_time_s: float | None) -> LoadCellReading:
        """Returns the reading at that time of the recording, interpolated linearly; raw counts in uN.

        Invalid and 0 N without a time, outside the recording, inside a gap; a sample at its edge is valid.
        """
        if recording_time_s is None or not self._time_s[0] <= recording_time_s <= self._time_s[-1]:
            return _NOTHING
        i = bisect_left(self._time_s, recording_time_s)
        if self._time_s[i] == recording_time_s:
            return _reading(self._force_n[i])
        span_s = self._time_s[i] - self._time_s[i - 1]
        if span_s > GAP_S:
            return _NOTHING
        share = (recording_time_s - self._time_s[i - 1]) / span_s
        return _reading(self._force_n[i - 1] + share * (self._force_n[i] - self._force_n[i - 1]))


def _reading(force_n: float) -> LoadCellReading:
    return LoadCellReading(force_n, round(force_n * 1e6), True)


def make_load_cell(settings: RecordedLoadCellSettings, _clock: Clock) -> RecordedLoadCell:
    """Loads the recording of the settings; RecordingError when it has no force."""
    recording = load_recording(settings.recording, settings.columns.mapping() if settings.columns else None)
    if recording.force_n is None:
        raise RecordingError(f"{settings.recording}: no force column; expected one for a recorded load cell")
    return RecordedLoadCell(recording.time_s.tolist(), (settings.force_sign * recording.force_n).tolist())
