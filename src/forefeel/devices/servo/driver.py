"""A handle whose positions another program of this host sends to a socket, as datagrams.

What it sends is the motion of a hand, and goes the way of any other: clutch, gate, limiter, safety state.
"""

import os
import socket
import struct
from collections import Counter
from contextlib import suppress
from pathlib import Path

from forefeel.common.clock import Clock
from forefeel.common.errors import DeviceSetupError
from forefeel.common.messages import MOST_POSITION_M, MOST_VELOCITY_M_S, within
from forefeel.devices.servo.settings import ServoSettings
from forefeel.master.handle import HandleReading, Indication

POSITION = struct.Struct("<qdd")
"""A datagram: stamp in ns of CLOCK_MONOTONIC, position in m, velocity in m/s."""
_MOST_A_TICK = 16  # datagrams: a sender that floods the socket does not hold up the haptic loop
_CARRIED_S = 0.02  # s by which a position is carried on with its velocity, as a stage's readback


class ServoHandle:
    """Handle port on positions that come to a socket; it gives no force. The deadman is pressed while they
    come: only a pause releases it, so that after a cleared stop nothing moves because they go on coming.

    Attributes:
        finished, pressed_anew, clutched_out_s: see the handle port; never.
        counters: datagrams taken, and those that are no position.
    """

    finished = pressed_anew = False
    clutched_out_s = actuator_delay_s = 0.0

    def __init__(self, path: Path, stale_s: float) -> None:
        self.counters: Counter[str] = Counter(positions=0, malformed=0)
        self._path, self._stale_ns = path, int(stale_s * 1e9)
        self._socket: socket.socket | None = None
        self._position_m = self._velocity_m_s = 0.0
        self._stamp_ns: int | None = None  # of the sender: what waited here is as old as it is
        self._fresh = False

    def open(self) -> None:
        """Makes the socket, for this user alone, in place of one that is there. DeviceSetupError: it can not,
        or another file is there.
        """
        opened = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        mask = os.umask(0o177)
        try:
            if self._path.is_socket():  # of a master that was killed
                self._path.unlink(missing_ok=True)
            opened.bind(str(self._path))
        except OSError as error:
            opened.close()
            raise DeviceSetupError(f"handle: {self._path}: {error.strerror or error}") from error
        finally:
            os.umask(mask)
        self._socket = opened

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._path.unlink(missing_ok=True)
            self._socket = None

    def rearm(self) -> None: ...

    def read(self, now_ns: int) -> HandleReading:
        """Takes what has come and returns the newest position, carried on for 20 ms at most, then at rest.
        The deadman counts as pressed unless the position is stale, or is the first after a pause, so that
        the clutch takes up where the hand is now.
        """
        if self._socket is not None:
            with suppress(BlockingIOError):
                for _ in range(_MOST_A_TICK):
                    self._take(self._socket.recv(POSITION.size + 1), now_ns)
        age_ns = 0 if self._stamp_ns is None else now_ns - self._stamp_ns
        was_fresh, self._fresh = self._fresh, self._stamp_ns is not None and age_ns <= self._stale_ns
        if not (self._fresh and was_fresh):
            return HandleReading(self._position_m, 0.0, False)
        carried_s = age_ns * 1e-9
        if carried_s > _CARRIED_S:
            return HandleReading(self._carried_m(_CARRIED_S), 0.0, True)
        return HandleReading(self._carried_m(carried_s), self._velocity_m_s, True)

    def _carried_m(self, duration_s: float) -> float:
        return within(self._position_m + self._velocity_m_s * duration_s, MOST_POSITION_M)

    def _take(self, data: bytes, now_ns: int) -> None:
        """Counts a datagram and stores its position; one of another size, beyond the range of the messages or
        older than the last is counted as malformed, too, and dropped.
        """
        self.counters["positions"] += 1
        if len(data) == POSITION.size:
            stamp_ns, position_m, velocity_m_s = POSITION.unpack(data)
            stamp_ns = min(stamp_ns, now_ns)  # it may come after the tick has begun
            possible = abs(position_m) <= MOST_POSITION_M and abs(velocity_m_s) <= MOST_VELOCITY_M_S
            if possible and stamp_ns >= (self._stamp_ns or 0):
                self._stamp_ns, self._position_m, self._velocity_m_s = stamp_ns, position_m, velocity_m_s
                return
        self.counters["malformed"] += 1

    def render(self, force_n: float, now_ns: int) -> float:
        """No hand feels it: 0."""
        del force_n, now_ns
        return 0.0

    def show(self, indication: Indication) -> None: ...


def make_servo(settings: ServoSettings, _clock: Clock) -> ServoHandle:
    return ServoHandle(settings.socket, settings.stale_s)
