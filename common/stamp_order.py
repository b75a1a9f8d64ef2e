"""Order of one stream by its stamps, in which a lone stamp from the future moves nothing. Pure."""

from typing import Literal

_LEAD_NS = 20_000_000
"""A stamp ahead by less hides the stream for less than a force may be late (`rendering.stale_s`, 0.1 s). In
the paper's jitter of +-15 ms a message is hardly ever that much faster than the fastest of a second."""
_MEMORY_NS = 1_000_000_000  # time constant with which a slower way replaces the fastest transit
_AGREEMENT_NS = 100_000_000  # by which the transits of a row may differ: three times that jitter
_ROW, _ROW_NS = 3, 50_000_000
"""Messages, over at least 50 ms: a cell of 10 Hz takes 0.2 s for them, a stream of 1 kHz 51 ms."""
Order = Literal["newer", "older", "ahead"]


class StampOrder:
    """Tells newer messages of one stream from older ones, and from those "ahead": whose transit (receive
    stamp minus stamp) is more than 20 ms below the fastest of about a second.

    At least three refused messages in a row, over 50 ms, whose transits agree are a clock that was set, or a
    way that became faster. If the last of them is ahead the stream begins anew with it; if it is older only
    with `backwards`, for a replay looks the same.

    Attributes:
        step_ns: by how much the stamps have stepped ahead, at the message that completes such a row; else 0.
    """

    def __init__(self, backwards: bool = False) -> None:
        self.step_ns = 0
        self._backwards = backwards
        self._newest_ns: int | None = None
        self._taken_ns = 0
        self._fastest_ns = 0.0
        self._row = (0, 0, 0)  # count, transit and receive stamp of the first

    def judge(self, stamp_ns: int, receive_ns: int) -> Order:
        """Order of a message: "newer" (it is the newest from now on), "older" (or equal), or "ahead" (over 20
        ms too early). Sets `step_ns`. The message that completes a row of refused ones (see the class) is
        "newer", an older one only with `backwards`.
        """
        transit_ns, self.step_ns = receive_ns - stamp_ns, 0
        slower_ns = transit_ns - self._fastest_ns
        order: Order = "newer"
        if self._newest_ns is None:
            slower_ns = 0.0
            self._fastest_ns = transit_ns
        elif stamp_ns <= self._newest_ns:
            order = "older"
        elif slower_ns < -_LEAD_NS:
            order = "ahead"
        if order != "newer":
            if not self._completes_row(transit_ns, receive_ns):
                return order
            self.step_ns = -round(slower_ns)
            if order == "older" and not self._backwards:
                return order
            self._taken_ns = receive_ns - _MEMORY_NS  # of the old clock nothing is kept
        share = min(1.0, (receive_ns - self._taken_ns) / _MEMORY_NS) if slower_ns > 0.0 else 1.0
        self._fastest_ns += share * slower_ns
        self._newest_ns, self._taken_ns, self._row = stamp_ns, receive_ns, (0, 0, 0)
        return "newer"

    def _completes_row(self, transit_ns: int, receive_ns: int) -> bool:
        """Adds a refused message to the row; True, and the row is emptied, once three or more agree over 50
        ms. One whose transit differs from the row's begins a new row.
        """
        count, row_transit_ns, first_ns = self._row
        if count == 0 or abs(transit_ns - row_transit_ns) > _AGREEMENT_NS:
            count, row_transit_ns, first_ns = 0, transit_ns, receive_ns
        complete = count + 1 >= _ROW and receive_ns - first_ns >= _ROW_NS
        self._row = (0, 0, 0) if complete else (count + 1, row_transit_ns, first_ns)
        return complete
