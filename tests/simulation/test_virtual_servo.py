"""Positions of another program move the stage as a hand does: through clutch, gate and limits."""

import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from forefeel.common.settings import AxisLimits
from forefeel.common.topics import FORCE
from forefeel.devices.servo.driver import POSITION
from tests.simulation.pair import OVERSHOOT, Pair, S

PERIOD_NS = 5_000_000
LIMITS = AxisLimits()
HOME_M = 0.7
"""Where the program's hand is, which is not where the stage is."""


class Rig:
    """A pair whose hand is a program that sends `motion(t)` at 200 Hz, position and velocity, or nothing."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "servo.sock"
        self.motion: Callable[[float], tuple[float, float] | None] = lambda t_s: None
        handle = {"driver": "servo", "socket": str(self.path)}
        self.pair = Pair(master={"axes": [{"handle": handle}]})
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self.pair.runtime.loop("program", PERIOD_NS, self._send)

    def _send(self, now_ns: int) -> None:
        motion = self.motion(now_ns / S)
        if motion is not None:
            self._socket.sendto(POSITION.pack(now_ns, *motion), str(self.path))

    def close(self) -> None:
        self._socket.close()
        self.pair.master.axes[0].handle.close()

    def stage_m(self) -> float:
        return self.pair.traffic.newest(FORCE).position_m

    def state(self) -> str:
        return self.pair.slave.axes[0].state.value


def at_rest(_t_s: float) -> tuple[float, float]:
    return HOME_M, 0.0


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    """Armed by a stream that has begun after a second without one."""
    rig = Rig(tmp_path)
    rig.pair.run(1.0)
    assert rig.state() == "ready"
    rig.motion = at_rest
    rig.pair.run(1.0)
    assert rig.state() == "armed"
    yield rig
    rig.close()


def test_the_stage_follows_the_changes_of_the_hand_and_stops_with_its_stream(rig: Rig) -> None:
    start_m, begun_s = rig.stage_m(), rig.pair.run(0.0)
    assert np.ptp(rig.pair.traffic.column(FORCE, "position_m")) < 1e-5  # the arming moved nothing
    rig.motion = lambda t_s: (HOME_M + 0.01 * min(t_s - begun_s, 1.0), 0.01 * (t_s - begun_s < 1.0))
    rig.pair.run(1.5)
    assert rig.stage_m() == pytest.approx(start_m + 0.01, abs=2e-4)
    rig.motion = lambda t_s: None
    rig.pair.run(0.5)
    assert rig.state() == "ready"
    assert [event for _, event in rig.pair.traffic.events()][-2:] == ["release", "at_rest"]


@pytest.mark.parametrize(("jump_m", "moved_m"), [(0.05, 0.05), (0.5, 0.0)])
def test_a_hand_that_jumps_moves_the_stage_within_its_limits_or_is_refused(
    rig: Rig, jump_m: float, moved_m: float
) -> None:
    start_m = rig.stage_m()
    rig.motion = lambda t_s: (HOME_M + jump_m, 0.0)
    rig.pair.run(2.0)
    speeds_m_s = np.abs(rig.pair.traffic.column(FORCE, "velocity_m_s"))
    assert rig.stage_m() == pytest.approx(start_m + moved_m, abs=2e-3)
    assert speeds_m_s.max() < OVERSHOOT * LIMITS.max_velocity_m_s
    assert bool(rig.pair.traffic.times("watchdog")) is (moved_m == 0.0)


def test_after_a_stop_that_was_cleared_nothing_moves_until_the_stream_has_paused(rig: Rig) -> None:
    (axis,) = rig.pair.slave.axes
    axis.emergency_stop("pause", "test")
    rig.pair.run(0.5)
    assert rig.state() == "estopped"
    axis.clear()
    rig.pair.run(2.0)
    assert rig.state() == "ready"
    rig.motion = lambda t_s: None
    rig.pair.run(0.3)
    rig.motion = at_rest
    rig.pair.run(1.0)
    assert rig.state() == "armed"
