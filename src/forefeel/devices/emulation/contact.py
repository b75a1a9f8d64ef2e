"""The simulated contact before an emulated stage, and the socket that takes its force to the load cell."""

import socket
import struct
from contextlib import suppress
from pathlib import Path

from forefeel.common.errors import ConfigurationError
from forefeel.slave.plant.contact import PlantFixture, plant_contact
from forefeel.slave.plant.settings import WorldSettings

_STEP_S = 2.5e-4  # s, step of the simulated contact
_FORCE = struct.Struct("<d")
_LONGEST_PATH = 100  # of a Unix socket: 108 bytes


class ContactSimulation:
    """The simulated vessel on the carriage of an emulated stage; always gripped.

    Attributes:
        force_n: on the load cell, at the time of the last motion.
    """

    def __init__(self, world: WorldSettings) -> None:
        contact, _ = plant_contact(world)
        self._fixture = PlantFixture(contact, world.fixture.inserted_m, world.stage.start_m)
        self._last: tuple[float, float, float] | None = None
        self.force_n = 0.0

    def moved(self, t_s: float, x_m: float, v_m_s: float, a_m_s2: float) -> None:
        """Steps the contact from the last call's motion to this one, each 0.25 ms, and sets `force_n` at its
        end. Position and velocity are interpolated linearly in between; the acceleration is that of now.
        """
        last_s, last_m, last_m_s = self._last or (t_s - _STEP_S, x_m, v_m_s)
        steps = max(1, round((t_s - last_s) / _STEP_S))
        dt_s = (t_s - last_s) / steps
        for step in range(1, steps + 1):
            share = step / steps
            x, v = last_m + share * (x_m - last_m), last_m_s + share * (v_m_s - last_m_s)
            self.force_n = self._fixture.step(last_s + step * dt_s, x, v, a_m_s2, dt_s)
        self._last = t_s, x_m, v_m_s


class ForceSender:
    """Sends the force to the emulated load cell, which may be another process and need not be there."""

    def __init__(self, path: Path) -> None:
        self._path = _short(path)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def send(self, force_n: float) -> None:
        with suppress(OSError):  # nobody listens yet, or does not keep up: the next one counts
            self._socket.sendto(_FORCE.pack(force_n), self._path)

    def close(self) -> None:
        self._socket.close()


class ForceReceiver:
    """Receives the force of a `ForceSender` at a socket of its own, which it makes at `path`, in place of one
    that is there. ConfigurationError: it can not, or another file is there.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            if path.is_socket():
                path.unlink(missing_ok=True)
            self._socket.bind(_short(path))
        except OSError as error:
            self._socket.close()
            raise ConfigurationError(f"--feel {path}: {error.strerror}; expected a free path") from error
        self._force_n = 0.0

    def newest_n(self) -> float:
        """The newest force received; 0 N before the first."""
        with suppress(BlockingIOError):
            while True:
                (self._force_n,) = _FORCE.unpack(self._socket.recv(_FORCE.size))
        return self._force_n

    def close(self) -> None:
        self._socket.close()
        with suppress(FileNotFoundError):
            self._path.unlink()


def _short(path: Path) -> str:
    if len(str(path)) > _LONGEST_PATH:
        raise ConfigurationError(
            f"--feel {path}: too long for a socket; expected at most {_LONGEST_PATH} bytes"
        )
    return str(path)
