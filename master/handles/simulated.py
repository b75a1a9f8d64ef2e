"""What the simulated handles have in common: a person, what the person sees, the time between two reads."""

from collections.abc import Mapping

from forefeel.master.handles.operator_policy import SimulatedOperatorPolicy
from forefeel.master.handles.port import Indication

_MAX_STEP_S = 0.05


class SimulatedHandle:
    """A handle without hardware, which does not fail.

    Attributes:
        person: who holds the deadman.
        finished: whether a motion that ends by itself has ended.
    """

    def __init__(self) -> None:
        self.person = SimulatedOperatorPolicy()
        self.finished = False
        self._indication = Indication(None, None)
        self._previous_ns: int | None = None

    @property
    def clutched_out_s(self) -> float:
        """Time that the person chose to spend with the clutch open."""
        return self.person.clutched_out_s

    def open(self) -> None:
        """Nothing to open."""

    def close(self) -> None:
        """Nothing to close."""

    def rearm(self) -> None:
        """Nothing to re-arm."""

    @property
    def pressed_anew(self) -> bool:
        """Only asked after a fault."""
        return False

    @property
    def counters(self) -> Mapping[str, int]:
        """Nothing is counted."""
        return {}

    def show(self, indication: Indication) -> None:
        """The person looks at it at the next read."""
        self._indication = indication

    def _step_s(self, now_ns: int) -> float:
        """Time in s since the last read; a stall of the host moves nobody for longer than 50 ms."""
        previous_ns, self._previous_ns = self._previous_ns, now_ns
        return 0.0 if previous_ns is None else min((now_ns - previous_ns) * 1e-9, _MAX_STEP_S)
