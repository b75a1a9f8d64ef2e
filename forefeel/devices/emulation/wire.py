"""An emulated device as bytes in and out, wire time and seeded faults between it and its host. Pure."""

import re
from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from random import Random
from typing import Protocol

from forefeel.common.errors import ConfigurationError

_BITS = 10  # start, eight data bits, stop
_RATES = "drop", "corrupt", "split", "delay"
_DELAY_S = 0.02  # s by which the fault `delay` delays
_AT = re.compile(r"([a-z_]+)@([0-9.]+)")


class EmulatedDevice(Protocol):
    @property
    def faults(self) -> Sequence[str]: ...

    def receive(self, data: bytes, t_s: float) -> None:
        """Takes bytes of the host that have arrived at that time."""
        ...

    def advance(self, t_s: float) -> bytes:
        """Lets the device live up to that time; the bytes that it sends now."""
        ...

    def provoke(self, fault: str) -> None:
        """Begins a fault of the device itself: `stuck`, `overrange`, `drive_fault`; `free` ends some.

        Raises:
            ConfigurationError: it has no such fault.
        """
        ...


@dataclass(frozen=True, slots=True)
class Faults:
    """Probabilities per chunk of bytes, and what happens at an instant since the start.

    `drop`: the chunk is lost; `corrupt`: one of its bytes is another; `split`: it comes in two parts;
    `delay`: it comes 20 ms late, and what follows after it. `at`: `unplug`, `plug`, `stuck`, `overrange`,
    `drive_fault` with their times in s.
    """

    drop: float = 0.0
    corrupt: float = 0.0
    split: float = 0.0
    delay: float = 0.0
    at: tuple[tuple[float, str], ...] = field(default=())

    @classmethod
    def parse(cls, text: str) -> "Faults":
        """`drop=0.01,corrupt=0.01,unplug@5,plug@6`; an empty text is no fault.

        Raises:
            ConfigurationError: an unknown fault, or a probability outside 0 to 1.
        """
        rates: dict[str, float] = {}
        at: list[tuple[float, str]] = []
        for part in filter(None, text.split(",")):
            name, _, value = part.partition("=")
            instant = _AT.fullmatch(part)
            if instant is not None:
                at.append((float(instant[2]), instant[1]))
            elif name in _RATES and _is_share(value):
                rates[name] = float(value)
            else:
                raise ConfigurationError(
                    f"--faults {part!r}: expected {', '.join(_RATES)} as NAME=0..1, or NAME@SECONDS"
                )
        return cls(**rates, at=tuple(sorted(at)))

    def require_known(self, names: Sequence[str]) -> None:
        """Raises ConfigurationError unless every fault of `at` is among the names."""
        for t_s, name in self.at:
            if name not in names:
                raise ConfigurationError(f"--faults '{name}@{t_s:g}': expected one of {', '.join(names)}")


class Timetable:
    """The faults of `Faults.at` that are still to happen."""

    def __init__(self, faults: Faults) -> None:
        self._at = deque(faults.at)

    def due(self, t_s: float) -> list[str]:
        """The faults that are due by then, in order; each is returned once."""
        found: list[str] = []
        while self._at and self._at[0][0] <= t_s:
            found.append(self._at.popleft()[1])
        return found


def _is_share(text: str) -> bool:
    try:
        return 0.0 <= float(text) <= 1.0
    except ValueError:
        return False


class Wire:
    """One direction: bytes take ten bits each at the baud rate, one after the other; faults befall chunks.

    Attributes:
        counts: what befell: `dropped`, `corrupted`, `split`, `delayed`, and `chunks`, `bytes`.
    """

    def __init__(self, baud: int, faults: Faults, seed: str) -> None:
        self._byte_s = _BITS / baud
        self._faults, self._random = faults, Random(seed)
        self._free_s = 0.0
        self._under_way: deque[tuple[float, bytes]] = deque()
        self.counts: Counter[str] = Counter()

    def send(self, data: bytes, t_s: float) -> None:
        """A chunk (a frame, a line) is given to the wire."""
        if not data:
            return
        self.counts["chunks"] += 1
        self.counts["bytes"] += len(data)
        for wait_s, part in self._befallen(data):
            start_s = max(self._free_s, t_s) + wait_s
            self._free_s = start_s + len(part) * self._byte_s
            self._under_way.append((self._free_s, part))

    def arrived(self, t_s: float) -> bytes:
        """The bytes that have arrived by then."""
        found = bytearray()
        while self._under_way and self._under_way[0][0] <= t_s:
            found += self._under_way.popleft()[1]
        return bytes(found)

    @property
    def next_s(self) -> float | None:
        """When the next part arrives; None when nothing is under way."""
        return self._under_way[0][0] if self._under_way else None

    def _befallen(self, data: bytes) -> list[tuple[float, bytes]]:
        faults, random = self._faults, self._random
        if faults.drop and random.random() < faults.drop:
            self.counts["dropped"] += 1
            return []
        if faults.corrupt and random.random() < faults.corrupt:
            self.counts["corrupted"] += 1
            at = random.randrange(len(data))
            data = data[:at] + bytes([data[at] ^ random.randrange(1, 256)]) + data[at + 1 :]
        wait_s = 0.0
        if faults.delay and random.random() < faults.delay:
            self.counts["delayed"] += 1
            wait_s = _DELAY_S
        if faults.split and len(data) > 1 and random.random() < faults.split:
            self.counts["split"] += 1
            at = random.randrange(1, len(data))
            return [(wait_s, data[:at]), (5.0 * self._byte_s, data[at:])]
        return [(wait_s, data)]
