"""The Zaber driver on the emulated stage in stepped time: it follows, it stops; faults, homing."""

from collections.abc import Callable
from dataclasses import replace
from datetime import date, timedelta
from math import cos, pi, sin, sqrt
from pathlib import Path
from typing import Any

import pytest
import yaml

from forefeel.common.errors import DeviceError, DeviceSetupError
from forefeel.common.hardware.link import LinkState
from forefeel.devices.zaber.emulator import ZaberModel
from forefeel.devices.zaber.homing import ZaberHoming
from tests.devices.zaber_rig import MODEL, Rig, rigged
from tests.emulators.damage import Faults

MS = 1_000_000


def test_handshake_identifies_writes_settings_once_and_moves_nothing() -> None:
    with rigged() as rig:
        assert rig.link.identity == "Zaber device id 50081, serial 73451, firmware 7.10"
        assert rig.moves() == [] and rig.link.counters["lost_replies"] == 0
        assert len([data for _, data in rig.line.sent if b" set " in data]) == 3  # checksum, maxspeed, accel
        rig.stage.close()
        rig.line.sent.clear()
        rig.stage.open()
        assert not [data for _, data in rig.line.sent if b" set " in data]


def sine(rig: Rig, seconds: float) -> tuple[float, float, float, float]:
    """Rms and largest error of the stage, rms of its readback's and of its read velocity's, in SI."""
    error, readback, velocity = list[float](), list[float](), list[float]()
    start_ns, w, amplitude_m = rig.now_ns, 2 * pi * 0.5, 0.008

    def loop(now_ns: int) -> None:
        t = (now_ns - start_ns) * 1e-9
        x = 0.01 + amplitude_m * (1 - cos(w * t))
        rig.stage.command(x, amplitude_m * w * sin(w * t), now_ns)
        sign, read = rig.settings.sign, rig.stage.read(now_ns)
        x_m, v_m_s, _ = rig.device.motion()
        if t > 0.5:
            error.append(sign * x_m - x)
            readback.append(read.position_m - sign * x_m)
            velocity.append(read.velocity_m_s - sign * v_m_s)

    rig.loop = loop
    rig.time.run(seconds)
    rms = [sqrt(sum(value * value for value in each) / len(each)) for each in (error, readback, velocity)]
    return rms[0], max(map(abs, error)), rms[1], rms[2]


def test_stage_follows_a_hand_and_reads_back() -> None:
    with rigged() as rig:
        rms_m, worst_m, readback_m, velocity_m_s = sine(rig, 3.0)
        assert rms_m < 60e-6 and worst_m < 150e-6 and readback_m < 60e-6 and velocity_m_s < 8e-3
        assert rig.link.counters["faults"] == 0


def test_stage_that_counts_against_insertion_follows() -> None:
    with rigged(replace(MODEL, limits_m=(-0.1, 0.005), start_m=-0.01), sign=-1) as rig:
        assert sine(rig, 2.0)[0] < 60e-6


def test_target_is_never_further_than_the_lead() -> None:
    with rigged(lead_s=0.05, max_velocity_m_s=0.08) as rig:
        ahead_m, goals_m = list[float](), list[float]()

        def loop(now_ns: int) -> None:
            rig.stage.command(0.08, 0.08, now_ns)  # far away, and on
            for line in rig.moves(rig.time.t_s - 0.001):
                goals_m.append(int(line.split(b"abs ")[1].split(b":")[0]) * MODEL.microstep_m)
                ahead_m.append(goals_m[-1] - rig.x_m)

        rig.loop = loop
        rig.time.run(0.5)
        # what the driver takes for the stage's place is as old as an exchange: a few ms of motion
        assert len(ahead_m) > 20 and max(ahead_m) <= 0.08 * (0.05 + 0.015) and max(goals_m) > 0.02


def test_targets_stay_within_the_travel() -> None:
    with rigged(travel_m=(0.0, 0.03)) as rig:
        applied = set[float]()
        rig.loop = lambda now_ns: applied.add(rig.stage.command(0.05, 0.1, now_ns))
        rig.time.run(1.0)
        assert applied == {0.03} and rig.x_m == pytest.approx(0.03, abs=1e-6)


def test_stage_rests_within_the_lead_when_setpoints_end() -> None:
    with rigged() as rig:
        start_ns = rig.now_ns

        def loop(now_ns: int) -> None:
            t = (now_ns - start_ns) * 1e-9
            if t < 0.4:
                rig.stage.command(0.01 + 0.05 * t, 0.05, now_ns)

        rig.loop = loop
        rig.time.run(1.0)
        assert rig.at_rest() and rig.x_m == pytest.approx(0.01 + 0.05 * (0.4 + rig.settings.lead_s), abs=2e-4)
        assert rig.link.counters["faults"] == 0


def test_setpoint_from_before_a_freeze_moves_nothing() -> None:
    with rigged() as rig:
        commanding = rig.loop = lambda now_ns: rig.stage.command(0.05, 0.05, now_ns)
        rig.time.run(0.3)
        assert not rig.at_rest()
        rig.loop = lambda now_ns: None
        rig.time.host_hangs(2.0)
        rested_m, thawed_s = rig.x_m, rig.time.t_s
        rig.stage.command(0.05, 0.05, rig.now_ns - 2000 * MS)  # a tick that was frozen on its way
        rig.time.run(0.1)
        assert rig.at_rest() and rig.x_m == rested_m and rig.moves(thawed_s + 1e-6) == []
        assert rig.link.counters["stood_still"] == 1 and rig.link.counters["faults"] == 0
        rig.loop = commanding
        rig.time.run(0.1)
        assert rig.x_m > rested_m + 0.002


def test_stage_of_a_dead_host_comes_to_rest() -> None:
    with rigged() as rig:
        rig.loop = lambda now_ns: rig.stage.command(0.05, 0.05, now_ns)
        rig.time.run(0.3)
        before_m = rig.x_m
        assert not rig.at_rest()
        rig.loop = lambda now_ns: None
        fast, lead_s = rig.settings.max_velocity_m_s, rig.settings.lead_s
        rig.time.host_hangs(lead_s + fast / rig.settings.max_acceleration_m_s2 + 0.02)
        assert rig.at_rest() and 0 < rig.x_m - before_m <= fast * (lead_s + 0.02)
        stays_m = rig.x_m
        rig.time.host_hangs(1.0)
        assert rig.x_m == stays_m


def test_hold_is_repeated_until_acknowledged() -> None:
    with rigged() as rig:
        rig.command(0.03)
        rig.time.run(0.15)
        assert not rig.at_rest()
        rig.stage.hold(0)
        rig.command(0.09, 0.1)  # a setpoint that comes after it waits
        rig.line.sent.clear()
        rig.line.silent = True
        rig.time.run_until(lambda: rig.line.sent)
        rig.time.run(0.03)
        rig.line.silent = False
        assert b" stop:" in rig.line.sent[0][1] and not rig.moves()
        rig.time.run(0.15)
        first = [data.split(b"\n")[0] for _, data in rig.line.sent]
        moves = [b" move abs" in line for line in first]
        at = moves.index(True)
        assert at > 1 and all(b" stop:" in line for line in first[:at])
        rig.stage.hold(0)
        rig.time.run(0.2)
        assert rig.at_rest()
        rig.line.sent.clear()
        rig.stage.hold(0)
        rig.time.run(0.1)
        assert rig.line.sent and all(
            b"get pos" in data and data.count(b"\n") == 1 for _, data in rig.line.sent
        )


def test_readback_is_carried_on_for_20_ms_at_most() -> None:
    with rigged() as rig:
        rig.command(0.05, 0.1)
        rig.time.run(0.1)
        exchange = rig.stage._exchange
        assert exchange is not None
        stamp_ns, (x, v) = exchange.reading
        assert v > 0.05
        assert tuple(rig.stage.read(stamp_ns + 10 * MS)) == pytest.approx((x + v * 0.01, v))
        assert rig.stage.read(stamp_ns + 300 * MS).position_m == pytest.approx(x + v * 0.02)
        assert rig.stage.read(stamp_ns - 5 * MS).position_m == x


def test_setpoint_from_before_a_close_moves_nothing() -> None:
    with rigged() as rig:
        rig.command(0.05)
        rig.stage.close()
        rig.time.run(0.1)
        at_m, since_s = rig.x_m, rig.time.t_s
        rig.stage.open()
        rig.time.run(0.2)
        assert rig.x_m == at_m and not rig.moves(since_s)


def test_close_leaves_the_stage_at_rest() -> None:
    with rigged() as rig:
        rig.command(0.09, 0.1)
        rig.time.run(0.3)
        rig.stage.close()
        assert rig.at_rest() and not rig.line.opened
        for call in (lambda: rig.stage.read(0), lambda: rig.command(0.0), lambda: rig.stage.hold(0)):
            with pytest.raises(DeviceError, match="link closed"):
                call()


# --- bad setups ---


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
    }
    path.write_text(yaml.safe_dump({**usual, **changes}))
    return path


NOISE, ANOTHER = bytes(range(128, 228)), b"@01 0 OK IDLE -- 0\r\n"


@pytest.mark.parametrize(
    ("model", "changes", "answer", "expected"),
    [
        (replace(MODEL, homed=False), {}, None, "expected a homed stage: run `forefeel home`"),
        (replace(MODEL, has_checksums=False), {}, None, "checksums stay off"),
        (replace(MODEL, max_velocity_m_s=0.09), {}, None, "stage.max_velocity_m_s = 0.1: rejected"),
        (MODEL, {"travel_m": (-0.006, 0.05)}, None, "travel_m = [-0.006, 0.05]: expected within"),
        (MODEL, {"axis": 2}, None, "BADAXIS"),
        (MODEL, {"device": 3}, None, "silence"),
        (MODEL, {}, NOISE, "no Zaber ASCII"),
        (MODEL, {"device": 2}, ANOTHER, "answers come from device 1"),
    ],
)
def test_wrong_setup_is_one_line_and_nothing_moves(
    model: ZaberModel, changes: dict[str, Any], answer: bytes | None, expected: str
) -> None:
    with rigged(model, opened=False, **changes) as rig:
        if answer is not None:
            rig.line.to_device.send = lambda data, t_s: rig.line.to_host.send(answer, t_s)  # type: ignore[method-assign]
        with pytest.raises(DeviceSetupError) as caught:
            rig.stage.open()
        text = str(caught.value)
        assert expected in text and "\n" not in text and text.count("memory") == 1
        assert rig.moves() == [] and not rig.line.opened


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"serial": "1"}, "serial = '1': expected '73451'"),
        ({"date": date.today() - timedelta(days=400)}, "out of date by 35 days"),
        ({"travel_m": [-0.001, 0.02]}, "expected it to cover stage.travel_m = [-0.002, 0.002]"),
        ({"native_per_m": 1e8}, "native_per_m = 1e+08: expected 1e+07 within 1%"),
    ],
)
def test_calibration_that_does_not_fit_is_refused(
    tmp_path: Path, changes: dict[str, Any], expected: str
) -> None:
    file = calibration(tmp_path, **changes)
    with rigged(opened=False, calibration=file, travel_m=(-0.002, 0.002)) as rig:
        with pytest.raises(DeviceSetupError) as caught:
            rig.stage.open()
        assert expected in str(caught.value) and "stage.yaml" in str(caught.value)


def test_calibration_gives_zero_scale_and_sign(tmp_path: Path) -> None:
    with rigged(calibration=calibration(tmp_path), travel_m=(-0.002, 0.002), sign=-1) as rig:
        assert rig.stage.read(rig.now_ns).position_m == pytest.approx((0.01 - 0.002) / -1)
        rig.command(0.001)
        rig.time.run(1.0)
        assert rig.x_m == pytest.approx(0.002 - 0.001)


# --- faults ---


def jam(rig: Rig) -> None:
    rig.device.provoke("stuck")


def free(rig: Rig) -> None:
    rig.device.provoke("free")


def line(rig: Rig, **changed: bool) -> None:
    vars(rig.line).update(changed)


def limits(rig: Rig, low: float, high: float) -> None:
    """Somebody else changes the limits in the stage."""
    rig.device.axis.limits = low, high


FAULTS: dict[str, tuple[Callable[[Rig], None], Callable[[Rig], None], str]] = {
    "jam": (jam, free, "FS (stalled and stopped)"),
    "drive": (lambda rig: rig.device.provoke("drive_fault"), lambda rig: None, "DRIVERDISABLED|FD"),
    "silence": (lambda rig: line(rig, silent=True), lambda rig: line(rig, silent=False), "no answer 3 times"),
    "unplug": (lambda rig: line(rig, plugged=False), lambda rig: line(rig, plugged=True), "gone while"),
    "reject": (lambda rig: limits(rig, 0, 1), lambda rig: limits(rig, -50_000, 1_000_000), "BADDATA"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_nothing_moves_after_a_fault_until_rearmed(name: str) -> None:
    fault, repair, expected = FAULTS[name]
    with rigged() as rig:
        rig.loop = lambda now_ns: rig.stage.command(0.08, 0.05, now_ns)
        rig.time.run(0.2)
        rig.line.sent.clear()
        fault(rig)
        said = rig.until_fault()
        assert any(word in said for word in expected.split("|")) and "\n" not in said
        assert rig.link.counters["faults"] == 1
        assert name in ("silence", "unplug") or any(b" stop:" in data for _, data in rig.line.sent)
        for call in (lambda: rig.command(0.0), lambda: rig.stage.read(0), rig.stage.rearm):
            with pytest.raises(DeviceError, match="stage zaber_ascii on memory: "):
                call()  # the handshake has not been repeated
        since_s = rig.time.t_s
        repair(rig)
        rig.time.run(3.0)
        assert rig.state() is LinkState.CONFIGURED and rig.at_rest() and rig.moves(since_s) == []
        rests_m = rig.x_m
        rig.loop = lambda now_ns: None
        rig.stage.rearm()
        rig.time.run(0.3)
        assert rig.state() is LinkState.READY and rig.x_m == rests_m and rig.moves(since_s) == []
        assert rig.stage.read(rig.now_ns).position_m == pytest.approx(rests_m, abs=1e-7)
        rig.command(rests_m + 0.001)
        rig.time.run(0.3)
        assert rig.x_m == pytest.approx(rests_m + 0.001, abs=1e-7)


def test_jam_that_stays_is_a_fault_again_and_a_power_cut_asks_for_homing() -> None:
    with rigged() as rig:
        jam(rig)
        for count in (1, 2):
            rig.command(0.05)
            assert "FS" in rig.until_fault() and rig.link.counters["faults"] == count
            free(rig) if count == 2 else None
            rig.until(LinkState.CONFIGURED)
            rig.stage.rearm()
        rig.time.run(0.1)
        rig.device.provoke("power_cycle")
        rig.time.run(1.0)
        assert "WR (no reference position)" in str(rig.link.inhibited)
        with pytest.raises(DeviceError, match="WR"):
            rig.stage.rearm()


@pytest.mark.parametrize(
    "faults",
    [Faults(0.02), Faults(0, 0.02), Faults(0, 0, 0.3), Faults(0, 0, 0, 0.05), Faults(0.01, 0.01, 0.1, 0.02)],
)
def test_damaged_bytes_cost_counted_replies_and_it_still_follows(faults: Faults) -> None:
    with rigged(faults=faults, seed=3) as rig:
        target_m, worst_m = 0.01, 0.0

        def loop(now_ns: int) -> None:
            nonlocal target_m, worst_m
            target_m = min(target_m + 20e-6, 0.06)  # 20 mm/s
            rig.stage.command(target_m, 0.02 if target_m < 0.06 else 0.0, now_ns)
            worst_m = max(worst_m, abs(rig.x_m - target_m))

        rig.loop = loop
        rig.time.run(3.5)
        rig.stage.close()
        counters = rig.link.counters
        befallen = rig.wires[0].counts + rig.wires[1].counts
        lost = befallen["dropped"] + befallen["corrupted"]
        if rig.link.inhibited is None:
            assert rig.x_m == pytest.approx(0.06, abs=1e-6) and worst_m < 3e-3
        # each lost chunk costs at most the two replies of its exchange
        assert counters["lost_replies"] <= 2 * lost and (counters["lost_replies"] > 0) is (lost > 0)
        assert counters["bad_checksum"] + counters["noise"] + counters["malformed"] <= 3 * lost
        assert lost or counters["faults"] == 0


def test_damaged_position_never_reaches_the_readback() -> None:
    with rigged(faults=Faults(corrupt=0.08), seed=1) as rig:
        seen = list[float]()
        rig.loop = lambda now_ns: seen.append(rig.stage.read(now_ns).position_m)
        rig.time.run(3.0)
        assert len(seen) > 100 and set(seen) == {0.01}
        assert rig.link.counters["bad_checksum"] > 5


def test_no_motion_is_made_after_a_fault_of_another_thread() -> None:
    with rigged() as rig:
        rig.command(0.02)
        rig.link.fault("noticed elsewhere")
        exchange = rig.stage._exchange
        assert exchange is not None
        with pytest.raises(DeviceError, match="noticed elsewhere"):
            exchange.step()
        assert rig.moves() == []


# --- homing ---


def test_homing_and_travel_of_an_unhomed_stage() -> None:
    with rigged(replace(MODEL, homed=False, start_m=0.03), opened=False, sign=-1) as rig:
        with ZaberHoming(rig.settings, rig.time) as found:
            assert found.link.serial == "73451" and found.native_per_m == 1e7
            assert found.home() == 0.0 and rig.x_m == pytest.approx(0.0, abs=1e-9)
            began_s = rig.time.t_s
            assert found.travel_ends(0.05) == (-50_000.0, 1_000_000.0)
            assert rig.time.t_s - began_s > (0.1 + 0.105) / 0.05
        assert not rig.line.opened and rig.at_rest()


def test_homing_that_fails_or_is_interrupted_ends_with_a_stop() -> None:
    with rigged(replace(MODEL, homed=False, start_m=0.09), opened=False) as rig:
        with ZaberHoming(rig.settings, rig.time) as found:
            with pytest.raises(DeviceError, match="takes too long; the stage has been stopped"):
                found.home(timeout_s=0.3)
            rig.time.run(0.1)
            assert rig.at_rest()
            jam(rig)
            with pytest.raises(DeviceError, match=r"FS \(stalled and stopped\) during 'home'"):
                found.home()
        free(rig)
        with pytest.raises(KeyboardInterrupt), ZaberHoming(rig.settings, rig.time):
            rig.device.receive(b"/1 1 move max\n", rig.time.t_s)
            rig.time.run(0.1)
            assert not rig.at_rest()
            raise KeyboardInterrupt
        rig.time.run(0.2)
        assert rig.at_rest() and not rig.line.opened


def test_travel_whose_answers_are_lost_is_stopped_before_anything_else() -> None:
    with rigged(opened=False) as rig, ZaberHoming(rig.settings, rig.time) as found:

        def lose(_now_ns: int) -> None:
            if rig.x_m > 0.02:
                rig.wires[1]._faults = Faults(drop=1.0)

        rig.time.tick = lose
        with pytest.raises(DeviceError):
            found.travel_ends(0.05)
        assert rig.at_rest() and rig.x_m < 0.04
