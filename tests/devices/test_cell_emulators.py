"""The emulated load cells: what they measure, and what they say to whom."""

from statistics import fmean, stdev

import pytest

from forefeel.common.errors import ConfigurationError
from forefeel.devices.ascii_line.emulator import EmulatedHx711, EmulatedLoadstar
from forefeel.devices.bota.emulator import EmulatedBota
from forefeel.devices.bota.protocol import BotaParser
from forefeel.devices.emulation.sensing import EmulatedSensor, Sensing


def measured(sensing: Sensing, slope: float = 0.0, count: int = 4000) -> list[float]:
    sensor = EmulatedSensor(sensing, lambda t_s: slope * t_s)
    return [sensor.measure((n + 1) / sensing.rate_hz) for n in range(count)]


def test_noise_bias_and_range_are_those_asked_for() -> None:
    got = measured(Sensing(800.0, noise_n=0.01, bias_n=0.3))
    assert fmean(got) == pytest.approx(0.3, abs=0.001)
    assert stdev(got) == pytest.approx(0.01, rel=0.05)
    assert max(measured(Sensing(800.0, full_scale_n=2.0), slope=1.0)) == 2.0


def test_the_filter_delays_a_ramp_by_its_delay() -> None:
    got = measured(Sensing(800.0, noise_n=0.0, filter_delay_s=0.05), slope=2.0)
    assert got[-1] == pytest.approx(2.0 * (5.0 - 0.05), abs=2.0 / 800)


def test_the_resolution_is_kept() -> None:
    for each in measured(Sensing(80.0, noise_n=0.1, resolution_n=0.05), count=100):
        assert each / 0.05 == pytest.approx(round(each / 0.05), abs=1e-9)


def test_bota_frames_come_at_their_rate_with_their_own_time() -> None:
    device = EmulatedBota(
        lambda _: 1.0, Sensing(800.0, noise_n=0.0), component="fx", start_us=(1 << 32) - 1500
    )
    frames = BotaParser().feed(device.advance(0.5) + device.advance(1.0))
    assert len(frames) == 800
    assert [frame.t_us for frame in frames[:3]] == [(1 << 32) - 250, 1000, 2250]
    assert {(frame.fx_n, frame.fz_n, frame.status) for frame in frames} == {(1.0, 0.0, 0)}


def test_a_loadstar_answers_its_commands() -> None:
    device = EmulatedLoadstar(lambda _: 4.4482216152605, Sensing(150.0, noise_n=0.0), number="077")
    device.advance(0.1)
    answers = []
    for command in (
        b"\r",
        b"O0W1\r",
        b"SS1\r",
        b"SLC\r",
        b"CT0\rO0W",
        b"1\r",
        b"nonsense\r",
        b"x" * 200 + b"\r",
    ):
        device.receive(command, 0.1)
        answers.append(device.advance(0.1))
    assert answers == [b"A\r\n", b"1000\r\n", b"077\r\n", b"2.25\r\n", b"A\r\n", b"0\r\n", b"", b""]
    device.receive(b"O0W0\r", 0.1)
    assert device.advance(0.2).count(b"\r\n") == 15
    device.receive(b"\r", 0.2)
    assert device.advance(0.4) == b"A\r\n"


def test_unknown_faults_are_refused() -> None:
    for device in (
        EmulatedBota(lambda _: 0.0),
        EmulatedLoadstar(lambda _: 0.0),
        EmulatedHx711(lambda _: 0.0),
    ):
        with pytest.raises(ConfigurationError, match=r"'drive_fault'.*expected stuck, overrange"):
            device.provoke("drive_fault")
