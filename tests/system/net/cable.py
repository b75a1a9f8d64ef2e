"""What joins two hosts: a forwarder of packets in software. Stamps are CLOCK_MONOTONIC in ns."""

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tests.system.net.namespaces import ip

ROOT = Path(__file__).parents[3]
ADDRESSES = "10.77.0.1", "10.77.0.2"
MEASURING = "10.78.0.1", "10.78.0.2"
_END_S = 5.0


class TunCable:
    """The forwarder, a process: see `tests.system.net.forwarder`. A cut is silent for both ends."""

    def __init__(self, names: Sequence[str], seed: int = 1) -> None:
        command = [sys.executable, "-m", "tests.system.net.forwarder", *names, str(seed)]
        self._process = subprocess.Popen(
            command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        try:
            self._answer()
            _address(names)
        except BaseException:
            self.close()
            raise

    def shape(self, way: str = "both", largest_bytes: int | None = None, **settings: Any) -> int:  # noqa: ANN401
        """From now on: the fields of `ImpairmentSettings`, or `preset`; without any it is transparent.

        `way`: `ab` (from the first host to the second), `ba` or both.
        """
        return self._order(do="shape", way=way, largest_bytes=largest_bytes, settings=settings)

    def stall(self, stall_s: float, way: str = "both") -> int:
        """Holds everything for that long, then delivers it in one burst."""
        return self._order(do="stall", way=way, stall_s=stall_s)

    def cut(self) -> int:
        """Pulls the cable, which neither end notices; when."""
        return self._order(do="cut")

    def mend(self) -> int:
        """Plugs it in again; when."""
        return self._order(do="mend")

    def forget(self) -> int:
        """From now on no packet passes of a TCP connection that there was; see `Way`."""
        return self._order(do="forget")

    def count(self) -> dict[str, Any]:
        self._say(do="count")
        return self._answer()

    def close(self) -> None:
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _order(self, **order: Any) -> int:  # noqa: ANN401
        self._say(**order)
        at_ns = self._answer()["at_ns"]
        assert isinstance(at_ns, int)
        return at_ns

    def _say(self, **order: Any) -> None:  # noqa: ANN401
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(order) + "\n")
        self._process.stdin.flush()

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        assert line, "the forwarder has ended"
        answer = json.loads(line)
        assert isinstance(answer, dict)
        return answer


def _address(names: Sequence[str]) -> None:
    for name, address in zip(names, ADDRESSES, strict=True):
        ip("-n", name, "address", "add", f"{address}/24", "dev", name)
        ip("-n", name, "link", "set", name, "up")
