"""A wire that loses, changes, cuts and delays what it carries, as its seed has it."""

from collections import Counter
from dataclasses import dataclass
from random import Random

from forefeel.devices.emulation.wire import Wire

_DELAY_S = 0.02


@dataclass(frozen=True, slots=True)
class Faults:
    """Probabilities per chunk: lost, one byte is another, in two parts, 20 ms late with what follows."""

    drop: float = 0.0
    corrupt: float = 0.0
    split: float = 0.0
    delay: float = 0.0


class DamagedWire(Wire):
    """Attributes:
    counts: `chunks`, and those that were `dropped`, `corrupted`, `split`, `delayed`.
    """

    def __init__(self, baud: int, faults: Faults, seed: str = "") -> None:
        super().__init__(baud)
        self.counts: Counter[str] = Counter()
        self._faults, self._random = faults, Random(seed)

    def carry(self, data: bytes, t_s: float, wait_s: float = 0.0) -> None:
        faults, random = self._faults, self._random
        self.counts["chunks"] += 1
        if self._befalls(faults.drop, "dropped"):
            return
        if self._befalls(faults.corrupt, "corrupted"):
            at = random.randrange(len(data))
            data = data[:at] + bytes([data[at] ^ random.randrange(1, 256)]) + data[at + 1 :]
        if self._befalls(faults.delay, "delayed"):
            wait_s = _DELAY_S
        if len(data) > 1 and self._befalls(faults.split, "split"):
            at = random.randrange(1, len(data))
            super().carry(data[:at], t_s, wait_s)
            data, wait_s = data[at:], 5.0 * self.byte_s
        super().carry(data, t_s, wait_s)

    def _befalls(self, share: float, name: str) -> bool:
        befalls = bool(share) and self._random.random() < share
        self.counts[name] += befalls
        return befalls


def damaged(baud: int, faults: Faults | None, seed: int = 0) -> tuple[DamagedWire, DamagedWire]:
    """The wires to a device and to its host."""
    wires = [DamagedWire(baud, faults or Faults(), f"{way} {seed}") for way in ("in", "out")]
    return wires[0], wires[1]
