"""Effect of a network on messages, as a pure function of their arrival times and a seed.

A link takes each message through: stall (it waits for its end), loss, delay with correlated jitter, order
(it never comes before its predecessor, but may be held back on purpose), duplication.
"""

from collections.abc import Sequence
from math import exp, sqrt
from random import Random
from typing import Protocol

from forefeel.common.transport.settings import ImpairmentSettings

_SECOND_NS = 1e9  # ns in a second
# s, longest gap between two stalls, 32 years: a rate near zero would draw one that is no integer
_NEVER_S = 1e9


class ImpairedLink(Protocol):
    """Decides what becomes of each message of one direction."""

    def plan(self, now_ns: int) -> tuple[int, ...]:
        """Delays in ns of the message that arrives now: none when it is lost, two when it is duplicated."""
        ...


class Impairment:
    """A random link with the statistics of its settings; the same seed and arrival times give the same plan.

    Loss in bursts is Gilbert's chain (Bell Syst. Tech. J. 39, 1960) with a bad state that loses all: with
    mean burst length L and share s, the bad state is left with r = 1 / L and entered with p = r s / (1 - s)
    per message.

    The delay varies as an Ornstein-Uhlenbeck process sampled at the messages:
    x <- a x + sigma sqrt(1 - a^2) w with a = exp(-dt / tau), sigma = jitter / 2, w standard normal, clipped
    to +-jitter. A message that would come before its predecessor comes together with it: where jitter is
    independent and messages are dense, this lengthens the mean delay.
    """

    def __init__(self, settings: ImpairmentSettings, seed: int) -> None:
        self._settings = settings
        self._random = Random(seed)
        self._leave_burst = 1 / settings.burst_length
        self._enter_burst = self._leave_burst * settings.burst_loss / (1 - settings.burst_loss)
        self._in_burst = False
        self._sigma_s = settings.jitter_s / 2
        self._variation_s = self._random.gauss(0, self._sigma_s)
        self._last_entry_ns: int | None = None
        self._last_due_ns = -(2**63)
        self._stall: tuple[int, int] | None = None

    def plan(self, now_ns: int) -> tuple[int, ...]:
        """Delays in ns of the message that arrives now: none when it is lost, two when it is duplicated.
        Keeps the order, but for messages drawn to be held back. Draws its stall, loss, delay, order and
        duplication, in turn, from the random state.
        """
        settings, draw = self._settings, self._random.random
        entry_ns = self._after_stall(now_ns) if settings.stalls_per_s else now_ns
        if self._enter_burst:
            self._in_burst ^= draw() < (self._leave_burst if self._in_burst else self._enter_burst)
        if (settings.loss and draw() < settings.loss) or self._in_burst:
            return ()
        delay_s = settings.delay_s
        if settings.jitter_s:
            self._vary(entry_ns)
            delay_s += min(max(self._variation_s, -settings.jitter_s), settings.jitter_s)
        due_ns = max(entry_ns + round(delay_s * _SECOND_NS), self._last_due_ns)
        if settings.reorder and draw() < settings.reorder:
            due_ns += round(settings.reorder_hold_s * _SECOND_NS)
        else:
            self._last_due_ns = due_ns
        delay_ns = due_ns - now_ns
        doubled = settings.duplicate and draw() < settings.duplicate
        return (delay_ns, delay_ns) if doubled else (delay_ns,)

    def _vary(self, entry_ns: int) -> None:
        """Advances `_variation_s`, the delay's variation in s, to the entry of this message; a message that
        enters at the same time keeps it. Drawn independently where the correlation time is 0.
        """
        elapsed_ns = 0 if self._last_entry_ns is None else max(entry_ns - self._last_entry_ns, 0)
        self._last_entry_ns = entry_ns
        tau_s = self._settings.jitter_correlation_s
        if not tau_s:
            self._variation_s = self._random.gauss(0, self._sigma_s)
        elif elapsed_ns:
            a = exp(-elapsed_ns / (tau_s * _SECOND_NS))
            self._variation_s = a * self._variation_s + self._random.gauss(0, self._sigma_s * sqrt(1 - a * a))

    def _after_stall(self, now_ns: int) -> int:
        """`now_ns`, or the end of the stall that holds the link then. Gaps between stalls are exponential."""
        start_ns, end_ns = self._stall or self._next_stall(now_ns)
        while now_ns >= end_ns:
            start_ns, end_ns = self._next_stall(end_ns)
        self._stall = start_ns, end_ns
        return end_ns if now_ns >= start_ns else now_ns

    def _next_stall(self, from_ns: int) -> tuple[int, int]:
        gap_s = min(self._random.expovariate(self._settings.stalls_per_s), _NEVER_S)
        start_ns = from_ns + round(gap_s * _SECOND_NS)
        return start_ns, start_ns + round(self._settings.stall_s * _SECOND_NS)


class ReplayedImpairment:
    """Plans for each message the delays of the next one in a recorded trace, again and again."""

    def __init__(self, trace: Sequence[tuple[int, ...]]) -> None:
        self._trace = tuple(trace)
        self._index = 0

    def plan(self, now_ns: int) -> tuple[int, ...]:
        del now_ns
        delays_ns = self._trace[self._index]
        self._index = (self._index + 1) % len(self._trace)
        return delays_ns
