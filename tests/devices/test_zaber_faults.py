"""The Zaber driver when something fails: bad setups, faults that nothing moves after, damaged bytes."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import date, timedelta
from pathlib import Path
from typing import Any

import pytest
import yaml

from forefeel.common.errors import DeviceError, DeviceSetupError
from forefeel.common.hardware.link import LinkState
from forefeel.devices.zaber.emulator import ZaberModel
from tests.devices.zaber_rig import MODEL, Rig, for_seconds


def calibration(folder: Path, **changes: object) -> Path:
    path = folder / "stage.yaml"
    usual: dict[str, object] = {
        "format": "forefeel.stage_calibration/1",
        "driver": "zaber_ascii",
        "serial": str(MODEL.serial),
        "date": date.today(),
        "zero": 20_000.0,
        "native_per_m": 1e7,
        "travel_m": [-0.02, 0.02],
        "repeatability_m": 1e-6,
    }
    path.write_text(yaml.safe_dump({**usual, **changes}))
    return path


@pytest.mark.parametrize(
    ("model", "changes", "expected"),
    [
        (
            replace(MODEL, homed=False),
            {},
            "WR (no reference position); expected a homed stage: run `forefeel c",
        ),
        (
            replace(MODEL, has_checksums=False),
            {},
            "checksums stay off (rejected, BADCOMMAND); expected a device",
        ),
        (
            replace(MODEL, max_velocity_m_s=0.09),
            {},
            "stage.max_velocity_m_s = 0.1: rejected (BADDATA), expected",
        ),
        (
            MODEL,
            {"travel_m": (-0.006, 0.05)},
            "travel_m = [-0.006, 0.05]: expected within [-0.005, 0.1], the",
        ),
        (MODEL, {"axis": 2}, "'get maxspeed' rejected: BADAXIS; expected a stage that takes its settings"),
        (
            MODEL,
            {"device": 3},
            "silence: no power, another baud rate, or another device; expected Zaber device 3",
        ),
    ],
)
def test_a_wrong_setup_is_one_line_and_nothing_moves(
    model: ZaberModel, changes: dict[str, Any], expected: str
) -> None:
    rig = Rig(model, **changes)
    with pytest.raises(DeviceSetupError) as caught:
        rig.run(for_seconds(rig, 1.0))
    text = str(caught.value)
    assert expected in text and text.startswith("stage zaber_ascii on memory: ")
    assert "\n" not in text and text.count("memory") == 1
    assert rig.moves() == [] and rig.opened == 0


def test_a_device_that_is_no_zaber() -> None:
    rig = Rig()
    rig.wires[0].send = lambda data, t_s: rig.wires[1].send(bytes(range(128, 228)), t_s)  # type: ignore[method-assign]
    with pytest.raises(
        DeviceSetupError, match="no Zaber ASCII: another device, or another baud rate; expected"
    ):
        rig.run(for_seconds(rig, 1.0))


def test_another_device_on_the_line() -> None:
    rig = Rig(device=2)
    rig.wires[0].send = lambda data, t_s: rig.wires[1].send(b"@01 0 OK IDLE -- 0\r\n", t_s)  # type: ignore[method-assign]
    with pytest.raises(DeviceSetupError, match="answers come from device 1; expected Zaber device 2"):
        rig.run(for_seconds(rig, 1.0))


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"serial": "1"}, "serial = '1': expected '73451'"),
        ({"date": date.today() - timedelta(days=400)}, "out of date by 35 days"),
        ({"travel_m": [-0.001, 0.02]}, "expected it to cover stage.travel_m = [-0.002, 0.002]"),
    ],
)
def test_a_calibration_that_does_not_fit(tmp_path: Path, changes: dict[str, Any], expected: str) -> None:
    rig = Rig(calibration=calibration(tmp_path, **changes), travel_m=(-0.002, 0.002))
    with pytest.raises(DeviceSetupError) as caught:
        rig.run(for_seconds(rig, 1.0))
    assert expected in str(caught.value) and "stage.yaml" in str(caught.value)


def test_a_calibration_gives_zero_scale_and_sign(tmp_path: Path) -> None:
    rig = Rig(calibration=calibration(tmp_path), travel_m=(-0.002, 0.002), sign=-1)

    def script() -> Iterator[None]:
        now_ns = rig.clock.now_ns()
        assert rig.stage.read(now_ns).position_m == pytest.approx((0.01 - 0.002) / -1)
        rig.stage.command(0.001, 0.0, now_ns)
        yield from for_seconds(rig, 1.0)
        assert rig.x_m == pytest.approx(0.002 - 0.001)

    rig.run(script())


def jam(rig: Rig) -> None:
    rig.device.provoke("stuck")


def free(rig: Rig) -> None:
    rig.device.provoke("free")


def drive_fault(rig: Rig) -> None:
    rig.device.provoke("drive_fault")


def silence(rig: Rig) -> None:
    rig.device_answers = False


def speak(rig: Rig) -> None:
    rig.device_answers = True


def unplug(rig: Rig) -> None:
    rig.plugged = False


def plug(rig: Rig) -> None:
    rig.plugged = True


def reject(rig: Rig) -> None:
    rig.device.axis.limits = (0.0, 1.0)  # somebody else has changed the limits: the next target is BADDATA


def nothing(_: Rig) -> None:
    pass


FAULTS: list[tuple[Callable[[Rig], None], Callable[[Rig], None], str]] = [
    (jam, free, "FS (stalled and stopped)"),
    (drive_fault, nothing, "DRIVERDISABLED|FD"),
    (silence, speak, "no answer 3 times in a row"),
    (unplug, plug, "gone while"),
    (reject, lambda rig: setattr(rig.device.axis, "limits", (-50_000, 1_000_000)), "BADDATA"),
]


@pytest.mark.parametrize(("fault", "repair", "expected"), FAULTS, ids=[each[0].__name__ for each in FAULTS])
def test_after_a_fault_nothing_moves_until_it_is_re_armed_and_then_without_a_jump(
    fault: Callable[[Rig], None], repair: Callable[[Rig], None], expected: str
) -> None:
    rig = Rig()
    link = rig.stage.link
    asked = [True]

    def tick(now_ns: int) -> None:
        if asked[0]:
            rig.stage.command(0.08, 0.05, now_ns)

    rig.tick = tick

    def script() -> Iterator[None]:
        yield from for_seconds(rig, 0.2)
        fault(rig)
        while rig.state() is LinkState.READY:
            yield
        assert any(word in str(link.inhibited) for word in expected.split("|"))
        assert link.counters["faults"] == 1 and not link.inhibited.count("\n")  # type: ignore[union-attr]
        for call in (lambda: rig.stage.command(0.0, 0.0, 0), lambda: rig.stage.read(0)):
            with pytest.raises(DeviceError, match="stage zaber_ascii on memory: "):
                call()
        since_s = rig.t_s
        with pytest.raises(DeviceError):
            rig.stage.rearm()  # the handshake has not been repeated
        repair(rig)
        for _ in range(40):
            yield
            rig.rest(0.05)
        assert rig.state() is LinkState.CONFIGURED and rig.at_rest()
        rests_m = rig.x_m
        assert rig.moves(since_s) == []
        asked[0] = False
        rig.stage.rearm()
        yield from for_seconds(rig, 0.3)
        assert rig.state() is LinkState.READY and rig.x_m == rests_m and rig.moves(since_s) == []
        assert rig.stage.read(rig.clock.now_ns()).position_m == pytest.approx(rests_m, abs=1e-7)
        rig.stage.command(rests_m + 0.001, 0.0, rig.clock.now_ns())
        yield from for_seconds(rig, 0.3)
        assert rig.x_m == pytest.approx(rests_m + 0.001, abs=1e-7)

    rig.run(script())
    assert link.counters["faults"] == 1 or expected.startswith("gone")


@pytest.mark.parametrize("fault", [drive_fault, reject])
def test_a_fault_of_the_stage_is_followed_by_a_stop(fault: Callable[[Rig], None]) -> None:
    rig = Rig()

    def script() -> Iterator[None]:
        rig.stage.command(0.08, 0.05, rig.clock.now_ns())
        yield from for_seconds(rig, 0.2)
        fault(rig)
        rig.sent.clear()
        while rig.state() is LinkState.READY:
            yield
        assert any(b" stop:" in data for _, data in rig.sent)

    rig.run(script())


def test_a_jam_that_stays_is_a_fault_again_and_a_power_cut_asks_for_homing() -> None:
    rig = Rig()
    link = rig.stage.link

    def script() -> Iterator[None]:
        jam(rig)
        rig.stage.command(0.05, 0.0, rig.clock.now_ns())
        while rig.state() is LinkState.READY:
            yield
        while rig.state() is not LinkState.CONFIGURED:
            yield
        rig.stage.rearm()
        rig.stage.command(0.05, 0.0, rig.clock.now_ns())
        while rig.state() is LinkState.READY:
            yield
        assert "FS" in str(link.inhibited) and link.counters["faults"] == 2
        free(rig)
        while rig.state() is not LinkState.CONFIGURED:
            yield
        rig.stage.rearm()
        yield from for_seconds(rig, 0.1)
        rig.device.provoke("power_cycle")
        for _ in range(10):
            yield
            rig.rest(0.1)
        assert "WR (no reference position)" in str(link.inhibited)
        with pytest.raises(DeviceError, match="WR"):
            rig.stage.rearm()

    rig.run(script())


def test_an_alert_of_a_fault_is_one() -> None:
    rig = Rig()

    def script() -> Iterator[None]:
        rig.device.receive(b"/1 0 set comm.alert 1\n", rig.t_s)
        rig.stage.command(0.02, 0.0, rig.clock.now_ns())
        yield from for_seconds(rig, 0.05)
        jam(rig)
        while rig.state() is LinkState.READY:
            yield

    rig.run(script())
    assert "FS (stalled and stopped)" in str(rig.stage.link.inhibited)


@pytest.mark.parametrize(
    "faults",
    ["drop=0.02", "corrupt=0.02", "split=0.3", "delay=0.05", "drop=0.01,corrupt=0.01,split=0.1,delay=0.02"],
)
def test_damaged_bytes_cost_replies_that_are_counted_and_the_stage_still_follows(faults: str) -> None:
    rig = Rig(faults=faults, seed=3)
    link, target_m = rig.stage.link, [0.01]
    worst_m = [0.0]

    def tick(now_ns: int) -> None:
        target_m[0] = min(target_m[0] + 20e-6, 0.06)  # 20 mm/s
        rig.stage.command(target_m[0], 0.02 if target_m[0] < 0.06 else 0.0, now_ns)
        worst_m[0] = max(worst_m[0], abs(rig.x_m - target_m[0]))

    rig.tick = tick

    def script() -> Iterator[None]:
        yield from for_seconds(rig, 3.5)

    rig.run(script())
    befallen = sum((wire.counts for wire in rig.wires), start=type(link.counters)())
    lost = befallen["dropped"] + befallen["corrupted"]
    if link.inhibited is None:
        assert rig.x_m == pytest.approx(0.06, abs=1e-6) and worst_m[0] < 3e-3
    # each lost chunk costs at most the two replies of its exchange, and none is lost without being counted
    assert link.counters["lost_replies"] <= 2 * lost
    assert (link.counters["lost_replies"] > 0) is (lost > 0)
    assert link.counters["bad_checksum"] + link.counters["noise"] + link.counters["malformed"] <= 3 * lost
    if not lost:
        assert link.counters["faults"] == 0


def test_a_damaged_position_never_reaches_the_readback() -> None:
    rig = Rig(faults="corrupt=0.08", seed=1)
    seen = list[float]()
    rig.tick = lambda now_ns: seen.append(rig.stage.read(now_ns).position_m)
    rig.run(for_seconds(rig, 3.0))
    assert len(seen) > 100 and set(seen) == {0.01}
    assert rig.stage.link.counters["bad_checksum"] > 5


def test_no_motion_is_even_made_once_another_thread_has_noticed_a_fault() -> None:
    rig = Rig()

    def script() -> Iterator[None]:
        rig.stage.command(0.02, 0.0, rig.clock.now_ns())
        rig.stage.link.fault("noticed elsewhere")
        exchange = rig.stage._exchange
        assert exchange is not None
        with pytest.raises(DeviceError, match="noticed elsewhere"):
            exchange.step()
        yield

    rig.run(script())
    assert rig.moves() == []
