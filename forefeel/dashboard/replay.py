"""A recording as the page shows it: the same view of a cell, at any of its times."""

from forefeel.common.recording.mcap_spans import RunSpans
from forefeel.common.topics import BY_NAME
from forefeel.dashboard.cell_view import UNREAD, CellView

LEAD_S = 20.0  # s that are read before the place asked for
_TOPICS = [topic for name, topic in BY_NAME.items() if name not in UNREAD]


class ReplayClock:
    """One viewer's place in a recording. The time goes on where it is asked for a little later than before.

    Elsewhere it begins `LEAD_S` earlier, so that traces, states and the usual size of errors are known.
    """

    def __init__(self, spans: RunSpans) -> None:
        self.cell = CellView("whole")
        self._spans = spans
        self._until_ns: int | None = None

    def go_to(self, at_s: float, window_s: float) -> int:
        """Takes in what was received before `at_s` of the recording; that time in ns.

        Raises:
            RecordingError: the file is damaged there.
        """
        start_ns, length_ns = self._spans.start_ns, self._spans.end_ns - self._spans.start_ns + 1
        until_ns = start_ns + round(min(max(at_s, 0.0) * 1e9, length_ns))
        lead_ns = round(max(LEAD_S, window_s) * 1e9)
        from_ns = self._until_ns
        if from_ns is None or not from_ns <= until_ns <= from_ns + lead_ns:
            from_ns = until_ns - lead_ns
            self.cell = CellView("part" if from_ns > start_ns else "whole")
        for logged in self._spans.between(from_ns, until_ns, _TOPICS):
            self.cell.take(logged.axis, logged.topic, logged.message, logged.log_ns)
        self._until_ns = until_ns
        return until_ns
