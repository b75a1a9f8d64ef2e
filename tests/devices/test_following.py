"""The slave's reference servo against emulated stages, led as the control loop leads them."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from math import cos, pi

import pytest

from forefeel.common.errors import DeviceError
from forefeel.common.estimation.stage_lag import StageLag
from forefeel.common.limiter import MotionLimiter
from forefeel.common.settings import AxisLimits
from forefeel.devices.cia402.driver import Cia402Stage
from forefeel.devices.zaber.driver import ZaberStage
from forefeel.slave.following import FollowingWatch, LateStage
from forefeel.slave.stage import StageDriverSettings
from forefeel.testing import SteppedTime
from tests.devices import can_rig, zaber_rig

MS = 1_000_000
STUCK_MS = 4400
LAG_S = StageDriverSettings.model_fields["lag_s"].default
Opened = tuple[SteppedTime, ZaberStage | Cia402Stage, Callable[[str], object]]


@contextmanager
def zaber() -> Iterator[Opened]:
    with zaber_rig.rigged(max_velocity_m_s=0.4, max_acceleration_m_s2=16.0) as rig:
        yield rig.time, rig.stage, rig.device.provoke


@contextmanager
def cia402() -> Iterator[Opened]:
    with can_rig.rigged("stage", stage={"max_velocity_m_s": 0.4, "following_error_m": 0.02}) as rig:
        yield rig.time, rig.stage, rig.drive.provoke


@pytest.mark.parametrize("opened", [zaber, cia402])
def test_emulated_stage_is_believed_until_it_is_stuck(
    opened: Callable[[], AbstractContextManager[Opened]],
) -> None:
    """Strokes, and steps that the limiter turns into 0.2 m/s and 8 m/s^2; CiA 402 at 50 Hz."""
    with opened() as (time, stage, provoke):
        start_ns = time.now_ns() // MS * MS
        limiter = MotionLimiter(AxisLimits(), 4.0)
        watch = FollowingWatch(LateStage(LAG_S), StageLag(LAG_S))
        limiter.place(stage.read(start_ns).position_m)
        faults = list[int]()

        def tick(now_ns: int) -> None:
            ms, off = divmod(now_ns - start_ns, MS)
            if off or faults:
                return
            try:
                why = watch.read(stage.read(now_ns), now_ns)
            except DeviceError as error:  # a Zaber that stalls says so by itself
                why = str(error)
            if why:
                faults.append(ms)
                return
            t = ms * 1e-3
            asked_m = 0.01 + (0.02 * (1 - cos(pi * t)) if not 2000 < ms < 3500 else 0.04 * (ms // 500 % 2))
            limiter.follow(asked_m, 0.0, 0.0, 1e-3)
            applied_m = stage.command(limiter.position_m, limiter.velocity_m_s, now_ns)
            watch.command(applied_m, limiter.velocity_m_s, now_ns)
            if ms == STUCK_MS:
                provoke("stuck")

        time.tick = tick
        time.run(5.0)
    assert len(faults) == 1 and 0 < faults[0] - STUCK_MS < 160
    assert watch.reaction_s is not None and sum(watch.reaction_s) < 0.04
