"""A slave axis and its devices: faults, limits, what it publishes of them."""

from collections.abc import Callable
from datetime import date
from itertools import pairwise
from math import copysign, cos, inf, nan, pi, sin

import pytest

from forefeel.common.clock import VirtualClock
from forefeel.common.errors import DeviceError
from forefeel.common.hardware.calibration import LoadCellCalibration, StageCalibration
from forefeel.common.hardware.link import DeviceLink
from forefeel.common.messages import ForceSample, Grip, SafetyState
from forefeel.common.topics import CALIBRATION, COMMAND, FORCE, LIMIT_EVENT
from forefeel.common.transport.memory import MemoryBus
from forefeel.slave.forces import ForcePublisher, Instant, PolarityWatch, PushWatch
from forefeel.slave.load_cell import LoadCellReading
from forefeel.slave.stage import StageReading
from tests.messages import usual
from tests.network import Party
from tests.unit.rigs import MS, SESSION, START_M, SlaveRig

S = SafetyState
CLOSED = Grip.CLOSED


def test_a_stage_that_can_not_even_hold_is_a_fault_and_the_loop_goes_on() -> None:
    rig = SlaveRig().armed()
    rig.stage.broken = {"read", "command", "hold"}
    rig.step(20)
    assert rig.state() is S.FAULT
    forces = rig.messages(FORCE)
    assert len(forces) == len(rig.load_cell.asked) + 20
    assert not any(force.valid for force in forces[-19:])


def test_stuck_stage_is_a_fault_and_does_not_leap_once_freed() -> None:
    rig = SlaveRig().armed()
    rig.stage.stuck, rig.fields = True, {"velocity_m_s": 0.05}
    for _ in range(100):
        rig.position_m += 5e-5
        rig.step()
    assert rig.state() is S.FAULT and "off its setpoint" in rig.reason
    asked = len(rig.stage.commands)
    rig.stage.stuck = False
    rig.step(100)
    assert (len(rig.stage.commands), rig.stage.position_m) == (asked, START_M)
    rig.axis.clear()
    rig.deadman, rig.position_m, rig.fields = False, START_M, {}
    rig.step(5)
    rig.deadman = True
    rig.step(40)
    assert rig.state() is S.ARMED
    moved_m = [abs(x_m - START_M) for _, x_m, _ in rig.stage.commands[asked:]]
    assert max(moved_m) < 1e-6


@pytest.mark.parametrize("force_n", [nan, inf, -inf, 5.01, -1e300])
def test_a_force_beyond_the_full_scale_is_a_fault_and_never_published(force_n: float) -> None:
    rig = SlaveRig().armed()
    rig.load_cell.reading = LoadCellReading(force_n, 0, True)
    rig.step()
    assert rig.state() is S.FAULT
    assert rig.reason == f"load cell = {force_n:g} N: expected at most its full scale, 5 N"
    force = rig.newest(FORCE)
    assert (force.valid, force.force_n) == (False, 0.0)
    assert rig.stage.holds[-1] == rig.now_ns


@pytest.mark.parametrize("value", [nan, 1001.0])
@pytest.mark.parametrize("field", ["position_m", "velocity_m_s"])
def test_a_readback_that_is_none_is_a_fault_and_the_last_one_stays(field: str, value: float) -> None:
    rig = SlaveRig().armed()
    rig.deadman = False
    rig.step(5)
    setattr(rig.stage, field, value)
    rig.step()
    assert rig.state() is S.FAULT
    assert "expected at most 10 m and 1000 m/s" in rig.reason
    assert rig.newest(FORCE).position_m == pytest.approx(START_M)


def test_an_axis_does_not_open_on_a_stage_that_does_not_say_where_it_is() -> None:
    rig = SlaveRig()
    rig.stage.position_m = nan
    with pytest.raises(DeviceError, match="expected at most 10 m and 1000 m/s"):
        rig.axis.open(rig.now_ns)
    rig.stage.position_m, rig.stage.broken = START_M, {"open"}
    with pytest.raises(DeviceError, match="open refused"):
        rig.axis.open(rig.now_ns)


def total(rig: SlaveRig, rule: str) -> int:
    return sum(event.count for event in rig.messages(LIMIT_EVENT) if event.rule == rule)


def test_every_intervention_of_the_loop_is_counted_once() -> None:
    rig = SlaveRig().armed()
    rig.position_m = 0.18  # beyond reason, which ends 50 mm outside of the workspace
    rig.step(20)
    rig.position_m = 0.16  # outside of the workspace only
    rig.step(700)
    rig.deadman = False
    rig.step(300)
    published = {rule: total(rig, rule) for rule in {event.rule for event in rig.messages(LIMIT_EVENT)}}
    assert published["range"] == 20
    assert published["workspace"] == 700
    assert sum(published.values()) == rig.counters()["limit_interventions"]
    times_ns = [event.stamp_ns for event in rig.messages(LIMIT_EVENT) if event.rule == "workspace"]
    assert all(later - earlier >= 100 * MS for earlier, later in pairwise(times_ns))
    assert rig.stage.position_m <= 0.12 + 1e-12


def test_a_drive_that_does_not_go_where_it_is_told_is_an_intervention() -> None:
    rig = SlaveRig().armed()
    rig.stage.travel_m = (0.0, START_M + 0.001)
    rig.position_m = START_M + 0.002
    rig.step(40)
    event = next(event for event in rig.messages(LIMIT_EVENT) if event.rule == "travel")
    assert (event.applied, event.unit) == (START_M + 0.001, "m")
    assert event.requested > event.applied


@pytest.mark.parametrize(
    ("force_n", "speed_m_s", "tare_n", "fault_ms"),
    [
        (-0.06, 0.02, 0.0, 60),  # 1 mm, then 10 ms
        (-0.04, 0.02, 0.0, None),
        (-0.06, 0.02, -0.02, None),
        (-0.6, 0.02, -0.5, 60),  # no more of a tare than a zero may be off
        (-0.06, 0.0019, 0.0, None),
        (-0.06, -0.02, 0.0, None),
        (0.9, 0.02, 0.0, None),
    ],
)
def test_inward_pull_is_a_fault(
    force_n: float, speed_m_s: float, tare_n: float, fault_ms: int | None
) -> None:
    """Of an axis with a force limit of 1 N."""
    watch = PushWatch(1.0)
    watch.fault(0, StageReading(0.0, 0.0), tare_n, valid=True, following=False)
    moved = ((ms, StageReading(speed_m_s * ms * 1e-3, speed_m_s)) for ms in range(1, 1000))
    found = (
        ms for ms, reading in moved if watch.fault(ms * MS, reading, force_n, valid=True, following=True)
    )
    assert next(found, None) == fault_ms


@pytest.mark.parametrize(
    ("force_n", "way_m", "fault"),
    [
        (-0.2, (0.0, 0.004), True),
        (0.2, (0.0, 0.004), False),
        (0.2, (0.0, -0.004), False),  # a wall that moves, on the way out
        (-0.2, (0.0, 0.009, 0.006), False),  # friction of the way out
        (-0.2, (0.0, 0.004, 0.003), True),  # late
        (-0.04, (0.0, 0.004), False),
        (-0.2, (0.0,), False),
        (-0.2, (0.0, 0.0002), False),
    ],
)
def test_polarity_is_told_by_first_force(force_n: float, way_m: tuple[float, ...], fault: bool) -> None:
    """Of an axis with a force limit of 1 N."""
    watch = PolarityWatch(1.0)
    watch.fault(0, StageReading(0.0, 0.0), 0.0, valid=True, following=False, grip=CLOSED)
    for ms, position_m in enumerate(way_m, 1):
        watch.fault(ms * MS, StageReading(position_m, 0.0), 0.0, valid=True, following=True, grip=CLOSED)
    at = StageReading(way_m[-1], 0.0)
    found = [
        watch.fault((10 + ms) * MS, at, force_n, valid=True, following=True, grip=CLOSED) for ms in range(10)
    ]
    assert any(found) == fault


def test_a_wire_that_is_inserted_already_tells_nothing_of_polarity() -> None:
    """Its friction turns on the way, whatever that is."""
    watch = PolarityWatch(1.0)
    watch.fault(0, StageReading(0.0, 0.0), -0.2, valid=True, following=False, grip=CLOSED)
    ways = ((ms, StageReading(0.001 * ms, 1.0)) for ms in range(1, 20))
    assert not any(
        watch.fault(ms * MS, way, -0.2, valid=True, following=True, grip=CLOSED) for ms, way in ways
    )


def test_force_that_is_not_valid_tells_nothing_of_its_sign() -> None:
    """On a way in by 20 mm/s, with a limit of 1 N."""
    pushes, polarity, began_blind = PushWatch(1.0), PolarityWatch(1.0), PolarityWatch(1.0)
    told = list[tuple[str | None, ...]]()
    pushes.fault(0, StageReading(0.0, 0.0), -4.9, valid=False, following=False)
    polarity.fault(0, StageReading(0.0, 0.0), 0.0, valid=True, following=False, grip=CLOSED)
    began_blind.fault(0, StageReading(0.0, 0.0), 0.0, valid=False, following=False, grip=CLOSED)
    pull = (-0.06, True)
    readings = [(0.0, True)] * 100 + [(-4.9, False)] * 100 + [pull] * 4 + [(4.9, False)] * 46 + [pull] * 12
    for ms, reading in enumerate(readings, 1):
        now = ms * MS, StageReading(2e-5 * ms, 0.02), *reading, True
        told.append((pushes.fault(*now), polarity.fault(*now, CLOSED), began_blind.fault(*now, CLOSED)))
    assert [sum(map(bool, each)) for each in zip(*told, strict=True)] == [3, 8, 0]  # of the last 12 ms


def friction(x_m: float, v_m_s: float, _stroke: int) -> float:
    return 0.1 + copysign(0.2, v_m_s)


def wall_late_by_10_ms(x_m: float, v_m_s: float, _stroke: int) -> float:
    return 100.0 * (x_m - 0.01 * v_m_s)


def adhesion(x_m: float, v_m_s: float, _stroke: int) -> float:
    """A wall that holds on to what is drawn back."""
    return 20.0 * x_m if v_m_s > 0.0 else -0.3


def heart(x_m: float, v_m_s: float, stroke: int) -> float:
    """A contact without friction that pushes on the way out, in every third stroke on the way in."""
    return 0.15 if (v_m_s < 0.0) == (stroke % 3 < 2) else 0.0


Force = Callable[[float, float, int], float]
STROKE_S, DEPTH_M = 2.0, 0.02


def first_fault_s(force: Force, sign: int, regrips: bool = False, valid: bool = True) -> float | None:
    """Time of the fault in 20 s of strokes, with a limit of 1 N, that begin loaded."""
    watch = PolarityWatch(1.0, "simulation.world.force_sign")
    watch.fault(0, StageReading(0.0, 0.0), -sign * 0.2, valid=True, following=False, grip=CLOSED)
    for ms in range(1, 20_000):
        phase = 2.0 * pi * ms * 1e-3 / STROKE_S
        x_m, v_m_s = 0.5 * DEPTH_M * (1.0 - cos(phase)), pi * DEPTH_M / STROKE_S * sin(phase)
        grip = Grip.OPEN if regrips and v_m_s > 0.0 else CLOSED
        force_n = sign * force(x_m, v_m_s, int(ms * 1e-3 / STROKE_S)) if grip is CLOSED else 0.0
        if fault := watch.fault(ms * MS, StageReading(x_m, v_m_s), force_n, valid, following=True, grip=grip):
            assert fault.endswith("its sign is wrong; change simulation.world.force_sign")
            return ms * 1e-3
    return None


@pytest.mark.parametrize("force", [friction, adhesion])
def test_force_that_drives_the_first_three_strokes_has_the_wrong_sign(force: Force) -> None:
    assert first_fault_s(force, -1) == pytest.approx(3.0 * STROKE_S + 0.2, abs=0.2)
    assert first_fault_s(force, 1) is None


@pytest.mark.parametrize("sign", [1, -1])
def test_force_that_only_seems_to_drive_strokes_tells_nothing(sign: int) -> None:
    assert first_fault_s(wall_late_by_10_ms, sign) is None
    assert first_fault_s(friction, sign, regrips=True) is None
    assert first_fault_s(friction, sign, valid=False) is None
    assert first_fault_s(heart, 1) is None  # drives some of them


CELL = LoadCellCalibration(
    format="forefeel.load_cell_calibration/1", driver="bota_serial", serial="SN-7", date=date(2026, 3, 1),
    gain_n=1.02, zero=-0.25, residual_n=0.001, hysteresis_n=0.002, range_n=(0.0, 3.0),
    points=((0.0, 0.0), (1.0, 1.02)),
)  # fmt: skip
STAGE = StageCalibration(
    format="forefeel.stage_calibration/1", driver="zaber_ascii", serial="4711", date=date(2026, 3, 2),
    zero=5000.0, native_per_m=1e7, travel_m=(0.0, 0.12),
)  # fmt: skip


def test_what_the_drivers_have_loaded_is_said_every_time() -> None:
    rig = SlaveRig().connected()
    rig.load_cell.calibration, rig.stage.calibration = CELL, STAGE  # type: ignore[attr-defined]
    for _ in range(2):
        rig.axis.announce(rig.now_ns)
        put = rig.messages(CALIBRATION)[-2:]
        assert [(each.slot, each.session_id) for each in put] == [("stage", SESSION), ("load_cell", SESSION)]
        assert [each.date for each in put] == ["2026-03-02", "2026-03-01"]
        for name in ["driver", "serial", "zero", "native_per_m", "gain_n", "residual_n", "hysteresis_n"]:
            assert [getattr(each, name) for each in put] == [getattr(c, name, None) for c in (STAGE, CELL)]


def test_what_the_drivers_counted_stands_among_the_counters_of_the_slave() -> None:
    rig = SlaveRig().connected()
    assert not [name for name in rig.counters() if name.startswith(("stage_", "load_cell_"))]
    rig.stage.link, rig.load_cell.link = DeviceLink("stage"), DeviceLink("cell")  # type: ignore[attr-defined]
    rig.stage.link.counters["lost_replies"] = 3  # type: ignore[attr-defined]
    rig.load_cell.link.counters.update(bad_checksum=2, stuck=0)  # type: ignore[attr-defined]
    counted = {n: c for n, c in rig.counters().items() if n.startswith(("stage_", "load_cell_"))}
    assert counted == {"stage_lost_replies": 3, "load_cell_bad_checksum": 2}


def answered(*stamps_ns: int | None) -> list[ForceSample]:
    """Ten ticks at 1 mm/s that execute a command each; then these readings."""
    party = Party(MemoryBus(), VirtualClock())
    answers = ForcePublisher(party.bus.publisher(FORCE))
    for tick in range(1, 11):
        command = usual(COMMAND, sequence=tick, stamp_ns=tick * MS)
        limits = tick * 2e-6, tick > 3
        stage = StageReading(tick * 1e-6, 1e-3)
        answers.note(Instant(tick * MS, stage, command, 5 * MS, Grip.CLOSED, *limits))
    for number, stamp_ns in enumerate(stamps_ns):
        answers.send(LoadCellReading(0.1 * number, number, True, stamp_ns), 1, None)
    return party.messages(FORCE)


def test_readings_of_a_batch_find_their_own_ticks() -> None:
    samples = answered(3 * MS, 3 * MS + MS // 4, 7 * MS)
    assert [s.answers_sequence for s in samples] == [3, 4, 7]
    assert [s.stamp_ns for s in samples] == [3 * MS, 3 * MS + MS // 4, 7 * MS]
    assert all(s.stamp_ns - (s.answers_stamp_ns or 0) == 5 * MS for s in samples)
    assert [s.position_m for s in samples] == pytest.approx([3e-6, 3.25e-6, 7e-6], abs=1e-12)
    assert [s.raw_counts for s in samples] == [0, 1, 2]
    assert [(s.setpoint_m, s.force_limited) for s in samples] == [(6e-6, False), (8e-6, True), (14e-6, True)]


@pytest.mark.parametrize(
    ("stamp_ns", "found"), [(None, (10 * MS, 10, 10e-6)), (7, (7, 1, 1e-6))], ids=["no stamp", "before all"]
)
def test_reading_without_tick_is_of_an_end(stamp_ns: int | None, found: tuple[int, int, float]) -> None:
    (sample,) = answered(stamp_ns)
    assert (sample.stamp_ns, sample.answers_sequence, sample.position_m) == pytest.approx(found, abs=1e-12)


def test_a_slow_cell_gives_as_many_messages_as_readings_and_its_newest_counts_until_it_is_stale() -> None:
    rig = SlaveRig().armed()
    rig.load_cell.every = 8
    before = len(rig.messages(FORCE))
    rig.step(80)
    assert len(rig.messages(FORCE)) - before == 10
    assert rig.state() is SafetyState.ARMED
    rig.load_cell.every = 1_000_000
    rig.step(1000)  # silent: stale after 20 ms, a fault after gate.force_timeout_s
    assert rig.state() is SafetyState.FAULT


@pytest.mark.parametrize(
    ("device", "call"), [("stage", "read"), ("stage", "command"), ("gripper", "set"), ("load_cell", "read")]
)
def test_a_device_that_fails_is_a_fault_until_a_clearing_rearms_it(device: str, call: str) -> None:
    rig = SlaveRig().armed()
    broken = getattr(rig, device)
    broken.broken = {call, "rearm"}
    rig.step(2)
    assert (rig.state(), rig.reason) == (S.FAULT, f"{broken.name}: {call} refused")
    force = rig.newest(FORCE)
    assert device != "load_cell" or (force.valid, force.force_n) == (False, 0.0)
    rig.axis.clear()
    rig.step(50)
    assert rig.state() is S.FAULT
    broken.broken = set()
    rig.step(100)
    assert rig.state() is S.FAULT
    assert rig.stage.holds[-1] == rig.now_ns
    rig.axis.clear()
    rig.step(2)
    assert rig.state() is S.READY
