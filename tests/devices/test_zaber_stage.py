"""The Zaber driver against the emulated stage in virtual time: it follows, it stops, it never runs away."""

from collections.abc import Iterator
from dataclasses import replace
from math import cos, pi, sin, sqrt

import pytest

from forefeel.common.errors import DeviceError
from forefeel.common.hardware.link import LinkState
from forefeel.devices.zaber.driver import ZaberStage
from tests.devices.zaber_rig import MODEL, Rig, for_seconds

MS = 1_000_000


def test_the_handshake_moves_nothing_and_says_who_answers() -> None:
    rig = Rig()
    states = list[LinkState]()

    def script() -> Iterator[None]:
        states.append(rig.state())
        yield

    rig.run(script())
    assert states == [LinkState.READY] and rig.stage.link.identity == (
        "Zaber device id 50081, serial 73451, firmware 7.10"
    )
    assert rig.moves() == [] and rig.opened == 0
    assert rig.stage.link.counters["lost_replies"] == 0


def test_settings_that_are_so_already_are_not_written_again() -> None:
    rig = Rig()
    rig.run(for_seconds(rig, 0.01))
    written = [line for _, line in rig.sent if b" set " in line]
    rig.sent.clear()
    rig.stage = ZaberStage(rig.settings, rig.clock, rig.open_stream)
    rig.run(for_seconds(rig, 0.01))
    assert len(written) == 3  # checksum, maxspeed, accel
    assert not [line for _, line in rig.sent if b" set " in line]


def sine(rig: Rig, seconds: float) -> tuple[list[float], list[float], list[float]]:
    """(error of the stage, of its readback, of its read velocity) in SI, at each tick after half a second."""
    error, readback, velocity = list[float](), list[float](), list[float]()
    start_ns, w, amplitude_m = [0], 2 * pi * 0.5, 0.008

    def tick(now_ns: int) -> None:
        start_ns[0] = start_ns[0] or now_ns
        t = (now_ns - start_ns[0]) * 1e-9
        x = 0.01 + amplitude_m * (1 - cos(w * t))
        rig.stage.command(x, amplitude_m * w * sin(w * t), now_ns)
        sign = rig.settings.sign
        x_m, v_m_s, _ = rig.device.motion()
        read = rig.stage.read(now_ns)
        if 0.5 < t < seconds - 0.1:
            error.append(sign * x_m - x)
            readback.append(read.position_m - sign * x_m)
            velocity.append(read.velocity_m_s - sign * v_m_s)

    rig.tick = tick
    rig.run(for_seconds(rig, seconds))
    return error, readback, velocity


def rms(values: list[float]) -> float:
    assert len(values) > 1000
    return sqrt(sum(value * value for value in values) / len(values))


def test_it_follows_a_hand_to_a_fraction_of_a_millimetre_and_reads_back_where_it_is() -> None:
    error, readback, velocity = sine(rig := Rig(), 3.0)
    assert rms(error) < 60e-6 and max(map(abs, error)) < 150e-6
    assert rms(readback) < 60e-6 and rms(velocity) < 8e-3
    assert rig.stage.link.counters["faults"] == 0


def test_a_stage_that_counts_against_the_insertion_follows_as_well() -> None:
    error, _, _ = sine(Rig(replace(MODEL, limits_m=(-0.1, 0.005), start_m=-0.01), sign=-1), 2.0)
    assert rms(error) < 60e-6


def test_no_target_is_further_ahead_than_the_lead_of_setpoint_and_stage() -> None:
    rig = Rig(lead_s=0.05, max_velocity_m_s=0.08)
    step_m = MODEL.microstep_m
    seen = list[tuple[float, float]]()

    def tick(now_ns: int) -> None:
        rig.stage.command(0.08, 0.08, now_ns)  # far away, and on
        for _, line in rig.moves(rig.t_s - 0.001):
            goal_m = int(line.split(b"abs ")[1].split(b":")[0]) * step_m
            seen.append((goal_m - rig.x_m, goal_m))

    rig.tick = tick
    rig.run(for_seconds(rig, 0.5))
    assert len(seen) > 20
    # what the driver takes for the stage's place is as old as an exchange: a few ms of motion
    assert max(ahead for ahead, _ in seen) <= 0.08 * (0.05 + 0.015)
    assert max(goal for _, goal in seen) > 0.02


def test_targets_stay_within_the_travel() -> None:
    rig = Rig(travel_m=(0.0, 0.03))
    applied = set[float]()
    rig.tick = lambda now_ns: applied.add(rig.stage.command(0.05, 0.1, now_ns))
    rig.run(for_seconds(rig, 1.0))
    assert applied == {0.03} and rig.x_m == pytest.approx(0.03, abs=1e-6)


def test_when_the_setpoints_end_the_stage_comes_to_rest_within_the_lead() -> None:
    rig = Rig()
    start_ns = list[int]()

    def tick(now_ns: int) -> None:
        start_ns.append(now_ns)
        t = (now_ns - start_ns[0]) * 1e-9
        if t < 0.4:
            rig.stage.command(0.01 + 0.05 * t, 0.05, now_ns)

    rig.tick = tick

    def script() -> Iterator[None]:
        yield from for_seconds(rig, 1.0)
        # the loop has hung, the driver's thread lives
        assert rig.at_rest() and rig.x_m == pytest.approx(0.01 + 0.05 * (0.4 + rig.settings.lead_s), abs=2e-4)

    rig.run(script())
    assert rig.stage.link.counters["faults"] == 0


def test_a_setpoint_from_before_a_freeze_of_the_whole_process_moves_nothing_after_it() -> None:
    rig = Rig()
    rig.tick = lambda now_ns: rig.stage.command(0.05, 0.05, now_ns)

    def script() -> Iterator[None]:
        yield from for_seconds(rig, 0.3)
        assert not rig.at_rest()
        commanding, rig.tick = rig.tick, lambda now_ns: None
        rig.rest(2.0)
        rested_m, thawed_s = rig.x_m, rig.t_s
        rig.stage.command(0.05, 0.05, rig.clock.now_ns() - 2000 * MS)  # a tick that was frozen on its way
        yield from for_seconds(rig, 0.1)
        assert rig.at_rest() and rig.x_m == rested_m
        assert rig.moves(thawed_s) == []
        assert rig.stage.link.counters["stood_still"] == 1
        rig.tick = commanding
        yield from for_seconds(rig, 0.1)
        assert rig.x_m > rested_m + 0.002

    rig.run(script())
    assert rig.stage.link.counters["faults"] == 0


def test_a_host_that_dies_leaves_the_stage_at_rest() -> None:
    rig = Rig()
    rig.tick = lambda now_ns: rig.stage.command(0.05, 0.05, now_ns)

    def script() -> Iterator[None]:
        yield from for_seconds(rig, 0.3)
        before_m = rig.x_m
        assert not rig.at_rest()
        rig.tick = lambda now_ns: None
        fast, lead_s, most = rig.settings.max_velocity_m_s, rig.settings.lead_s, rig.settings
        rig.rest(lead_s + fast / most.max_acceleration_m_s2 + 0.02)  # the host does nothing at all
        assert rig.at_rest() and 0 < rig.x_m - before_m <= fast * (lead_s + 0.02)
        stays_m = rig.x_m
        rig.rest(1.0)
        assert rig.x_m == stays_m
        yield

    rig.run(script())


def test_hold_goes_before_everything_and_is_repeated_until_it_is_acknowledged() -> None:
    rig = Rig()

    def script() -> Iterator[None]:
        rig.stage.command(0.03, 0.0, rig.clock.now_ns())
        yield from for_seconds(rig, 0.15)
        assert not rig.at_rest()
        rig.stage.hold(0)
        rig.stage.command(0.09, 0.1, rig.clock.now_ns())  # a setpoint that comes after it waits
        rig.sent.clear()
        rig.device_answers = False
        yield
        rig.device_answers = True
        assert [data.split(b"\n")[0].split(b":")[0][-4:] for _, data in rig.sent] == [b"stop"]
        yield from for_seconds(rig, 0.05)
        texts = [data.split(b"\n")[0] for _, data in rig.sent]
        assert b" stop" in texts[1] and b" move abs" in texts[2]
        rig.stage.hold(0)
        yield from for_seconds(rig, 0.2)
        assert rig.at_rest()
        rig.sent.clear()
        rig.stage.hold(0)
        yield from for_seconds(rig, 0.1)
        assert rig.sent and all(b"get pos" in data and data.count(b"\n") == 1 for _, data in rig.sent)

    rig.run(script())


def test_the_readback_is_carried_on_for_at_most_20_ms() -> None:
    rig = Rig()

    def script() -> Iterator[None]:
        rig.stage.command(0.05, 0.1, rig.clock.now_ns())
        yield from for_seconds(rig, 0.1)
        exchange = rig.stage._exchange
        assert exchange is not None
        stamp_ns, _, (x, v) = exchange.reading
        assert v > 0.05
        assert tuple(rig.stage.read(stamp_ns + 10 * MS)) == pytest.approx((x + v * 0.01, v))
        assert rig.stage.read(stamp_ns + 300 * MS).position_m == pytest.approx(x + v * 0.02)
        assert rig.stage.read(stamp_ns - 5 * MS).position_m == x

    rig.run(script())


def test_numbers_that_are_none_are_refused_and_do_not_move_the_stage() -> None:
    rig = Rig()

    def script() -> Iterator[None]:
        for position_m, velocity_m_s in ((float("nan"), 0.0), (0.0, float("inf"))):
            with pytest.raises(DeviceError, match="expected finite numbers"):
                rig.stage.command(position_m, velocity_m_s, rig.clock.now_ns())
        yield from for_seconds(rig, 0.05)

    rig.run(script())
    assert rig.moves() == []


def test_the_end_leaves_it_at_rest() -> None:
    rig = Rig()

    def script() -> Iterator[None]:
        rig.stage.command(0.09, 0.1, rig.clock.now_ns())
        yield from for_seconds(rig, 0.3)

    rig.run(script())
    assert rig.at_rest() and rig.opened == 0
    with pytest.raises(DeviceError, match="link closed"):
        rig.stage.command(0.0, 0.0, 0)


def test_closed_it_gives_nothing() -> None:
    stage = Rig().stage
    for call in (lambda: stage.read(0), lambda: stage.command(0.0, 0.0, 0), lambda: stage.hold(0)):
        with pytest.raises(DeviceError, match="stage zaber_ascii on memory: link closed, expected it ready"):
            call()
