"""What a person or a script tells an emulated device while it runs: one command a line on stdin."""

import os
import select
import sys
from collections.abc import Callable, Sequence
from math import isfinite

from forefeel.common.errors import ConfigurationError
from forefeel.devices.emulation.bench import Load
from forefeel.terminal import complain

_LONGEST_LINE = 200  # characters of an order
_SHOWN_CHARACTERS = 40  # characters of an unknown order that the complaint repeats
_CHUNK_BYTES = 4096  # bytes of one read
_MOST_N = 1e6  # N, largest load


class OrderReader:
    """Obeys lines: `load 1.5` where there is a load cell, and the names of the device's faults.

    Args:
        faults: the names.
        provoke: begins one of them.
        load: what `load` changes; None: no load cell.
    """

    def __init__(self, faults: Sequence[str], provoke: Callable[[str], None], load: Load | None) -> None:
        self._faults, self._provoke, self._load = tuple(faults), provoke, load

    @property
    def words(self) -> str:
        """What there is to say."""
        return ", ".join(([] if self._load is None else ["load N"]) + list(self._faults))

    def obey(self, line: str) -> None:
        """One line; an empty one is nothing.

        Raises:
            ConfigurationError: not one of the commands; nothing has changed.
        """
        words = line.split()
        if not words:
            return
        if len(words) == 1 and words[0] in self._faults:
            self._provoke(words[0])
        elif words[0] == "load" and len(words) == 2 and self._load is not None and len(line) <= _LONGEST_LINE:
            self._load.force_n = _force_n(words[1])
        else:
            raise ConfigurationError(f"{line.strip()[:_SHOWN_CHARACTERS]!r}: expected {self.words}")


def _force_n(word: str) -> float:
    try:
        force_n = float(word)
    except ValueError:
        force_n = float("nan")
    if not (isfinite(force_n) and abs(force_n) <= _MOST_N):
        raise ConfigurationError(f"'load {word}': expected a force in N, such as load 1.5")
    return force_n


class OrdersFromStdin:
    """Reads stdin as far as lines have come, without ever waiting. It need not be open, and may end.

    A line that is wrong is answered on stderr. In the background of a terminal nothing is read: the system
    would stop the process for it.
    """

    def __init__(self, orders: OrderReader) -> None:
        self._orders = orders
        self._end = _open_stdin()
        self._partial = b""

    def step(self) -> None:
        """Obeys what has come."""
        if self._end is None or not select.select([self._end], [], [], 0.0)[0] or _in_background(self._end):
            return
        try:
            data = os.read(self._end, _CHUNK_BYTES)
        except OSError:
            data = b""
        *lines, partial = (self._partial + data).split(b"\n")
        if not data:
            self._end, lines, partial = None, [*lines, partial], b""
        self._partial = partial[: _LONGEST_LINE + 1]
        for line in lines:
            self._obey(line.decode("utf-8", "replace"))

    def _obey(self, line: str) -> None:
        try:
            self._orders.obey(line)
        except ConfigurationError as error:
            complain(str(error))


def _open_stdin() -> int | None:
    """Its descriptor; None where there is none (a closed one may be another file by now)."""
    try:
        return None if sys.stdin is None else sys.stdin.fileno()
    except (OSError, ValueError):
        return None


def _in_background(end: int) -> bool:
    try:
        return os.isatty(end) and os.tcgetpgrp(end) != os.getpgrp()
    except OSError:
        return True
