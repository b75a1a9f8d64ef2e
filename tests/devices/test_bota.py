"""The Bota stream, and its driver against the emulator: rate, stamps, validity, faults."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from math import inf, nan
from pathlib import Path
from random import Random

import pytest

from forefeel.common.errors import DeviceError, DeviceSetupError
from forefeel.devices.bota.driver import BotaSerialLoadCell
from forefeel.devices.bota.emulator import EmulatedBota
from forefeel.devices.bota.protocol import BAUD, FRAME_BYTES, BotaFrame, BotaParser, encode
from forefeel.devices.bota.settings import BotaSettings
from forefeel.devices.emulation.sensing import EmulatedSensor
from forefeel.devices.shared.device_time import DeviceTime
from tests.devices.cell_bench import NAME, Port, stamp_s
from tests.emulators.damage import Faults

GOLDEN = bytes.fromhex(
    "aa"  # header
    "0200"  # status: overrange
    "0000803f" "000000c0" "0000003f"  # forces 1, -2, 0.5 N
    "0000803e" "00000000" "000080bf"  # torques 0.25, 0, -1 N m
    "04030201"  # 0x01020304 us
    "0000c841"  # 25 degrees
    "ae5b"  # CRC-16/X-25, low byte first
)  # fmt: skip
FRAME = BotaFrame(2, 1.0, -2.0, 0.5, 0.25, 0.0, -1.0, 0x01020304, 25.0)


def crc_by_bits(data: bytes) -> int:
    """CRC-16/X-25 as the catalogue defines it: reflected 1021, start and end FFFF."""
    crc = 0xFFFF
    for byte in data:
        for bit in range(8):
            odd = (crc ^ byte >> bit) & 1
            crc = crc >> 1 ^ (0x8408 if odd else 0)
    return crc ^ 0xFFFF


def frames(count: int) -> list[BotaFrame]:
    random = Random(5)
    return [
        FRAME._replace(status=0, fz_n=random.randrange(-999, 999) / 8, t_us=n * 1250) for n in range(count)
    ]


def test_the_published_layout() -> None:
    assert crc_by_bits(b"123456789") == 0x906E
    assert len(GOLDEN) == FRAME_BYTES == 37
    assert int.from_bytes(GOLDEN[-2:], "little") == crc_by_bits(GOLDEN[1:-2])
    assert encode(FRAME) == GOLDEN
    assert BotaParser().feed(GOLDEN) == [FRAME]


@pytest.mark.parametrize("at", range(FRAME_BYTES))
def test_one_damaged_byte_costs_one_frame(at: int) -> None:
    sent = frames(3)
    stream = bytearray(b"".join(map(encode, sent)))
    stream[FRAME_BYTES + at] ^= 0xAA if at else 0x01  # also makes a header where a zero was
    parser = BotaParser()
    assert parser.feed(bytes(stream)) == [sent[0], sent[2]]
    assert parser.counters["junk_bytes"] == FRAME_BYTES
    assert parser.counters["resynchronised"] == 1


def test_it_begins_in_the_middle_of_a_frame_and_of_headers() -> None:
    sent = frames(2)
    parser = BotaParser()
    stream = b"\xaa" * 500 + encode(sent[0])[11:] + encode(sent[0]) + encode(sent[1])
    assert parser.feed(stream) == sent
    assert parser.counters["junk_bytes"] == 500 + 26
    assert parser.counters["bad_checksum"] >= 500


def test_what_is_no_measurement() -> None:
    good = FRAME._replace(status=0)
    assert good.valid
    assert good._replace(status=0xFFF0).valid, "reserved bits mean nothing"
    for bit, name in enumerate(("app_took_too_long", "overrange", "invalid", "raw")):
        flawed = good._replace(status=1 << bit)
        assert not flawed.valid
        assert flawed.flags == (name,)
    for number in (nan, inf, -inf):
        for bad in (
            good._replace(fx_n=number),
            good._replace(mz_n_m=number),
            good._replace(temperature_c=number),
        ):
            (got,) = BotaParser().feed(encode(bad))
            assert not got.finite
            assert not got.valid


SETTINGS = BotaSettings(driver="bota_serial", port=NAME, full_scale_n=10.0, serial="B-17")
CALIBRATION = """
format: forefeel.load_cell_calibration/1
driver: bota_serial
serial: {serial}
date: 2026-01-15
valid_days: 3650
gain_n: 2.0
zero: 0.25
residual_n: 0.001
hysteresis_n: 0.001
range_n: [-5.0, 5.0]
points: [[0.25, 0.0], [1.25, 2.0]]
"""


def slope(t_s: float) -> float:
    return 0.1 * t_s


def device(feel: Callable[[float], float] = slope, noise_n: float = 0.0) -> EmulatedBota:
    return EmulatedBota(EmulatedSensor(feel, 800.0, noise_n=noise_n))


class Drifting(EmulatedBota):
    """Its clock begins anew after 3 s, and is fast by `drift_ppm`."""

    drift_ppm = 0.0

    def clock_us(self, t_s: float) -> int:
        return (1 << 32) - 3_000_000 + int(t_s * (1e6 + self.drift_ppm))


def opened(port: Port, settings: BotaSettings = SETTINGS) -> AbstractContextManager[BotaSerialLoadCell]:
    return port.opened(lambda time: BotaSerialLoadCell(settings, time))


def test_one_reading_per_frame_with_the_time_of_its_measurement() -> None:
    port = Port(device(), BAUD)
    with opened(port) as driver:
        assert driver.stale_s == pytest.approx(3 / 800 + 0.02)
        assert driver.measured_hz == pytest.approx(800, rel=0.002)
        got = port.played(driver, 1.0)
        assert len(got) == 800
        assert all(reading.valid for reading in got)
        for reading in got:
            assert reading.force_n == pytest.approx(slope(stamp_s(reading)), abs=0.1 * 0.0006)
            assert reading.raw_counts == round(reading.force_n * 1e6)
        assert driver.link.counters["missing"] == 0
        assert driver.read(0, None) == []
    with pytest.raises(DeviceError, match="closed"):
        driver.read(0, None)


@pytest.mark.parametrize(("hub_s", "drift_ppm"), [(0.016, 0.0), (0.016, 200.0), (0.004, -200.0)])
def test_stamps_are_within_a_period_though_an_adapter_collects(hub_s: float, drift_ppm: float) -> None:
    emulated = Drifting(EmulatedSensor(slope, 800.0, noise_n=0.0))
    emulated.drift_ppm = drift_ppm
    port = Port(emulated, BAUD, hub_s=hub_s)
    with opened(port) as driver:
        port.time.run(1.5)
        before_s = port.time.t_s
        got = [reading for _ in range(20) for reading in port.played(driver, 0.2)]
        lasted_s = port.time.t_s - before_s
    assert len(got) == pytest.approx(lasted_s * 800, abs=3 * 0.016 * 800)
    made_s = [reading.force_n / 0.1 for reading in got]
    assert max(abs(stamp_s(each) - true_s) for each, true_s in zip(got, made_s, strict=True)) < 1 / 800
    stamps = [stamp_s(each) for each in got]
    assert stamps == sorted(set(stamps))
    assert before_s - 0.04 < stamps[0]
    assert stamps[-1] <= port.time.t_s


def test_stamps_are_never_in_the_future_and_a_reset_is_noticed() -> None:
    random, time, now_ns = Random(3), DeviceTime(0.00125), 0
    for n in range(4000):
        now_ns = max(now_ns, n * 1_250_000 + random.randrange(30_000_000))
        (stamp_ns,) = time.stamps([(n * 1250 + 4_294_000_000) % (1 << 32)], now_ns)
        assert stamp_ns <= now_ns
    assert time.counters["missing"] == 0
    with pytest.raises(DeviceError, match="reset"):
        time.stamps([0], now_ns)


def test_silent_device_is_a_fault_after_50_ms() -> None:
    port = Port(device(), BAUD)
    with opened(port) as driver:
        port.line.silent = True
        port.time.run(0.045)
        driver.read(0, None)
        port.time.run(0.015)
        with pytest.raises(DeviceError, match=r"nothing for [56]"):
            driver.read(0, None)


def test_a_host_that_stood_still_finds_late_readings_and_then_those_of_now_in_their_places() -> None:
    time, second_ns = DeviceTime(1.25e-3), 1_000_000_000
    for number in range(800):
        stamp_us = 1_250 * number
        assert time.stamps([stamp_us], 10 * second_ns + stamp_us * 1000) == [10 * second_ns + stamp_us * 1000]
    woken_ns = 14 * second_ns  # 3 s later: the first 100 readings of them waited, the others were lost
    late_us = [1_250 * number for number in range(800, 900)]
    assert time.stamps(late_us, woken_ns) == [10 * second_ns + each * 1000 for each in late_us]
    now_us = 4_000_000
    assert time.stamps([now_us], woken_ns + 1_000_000) == [woken_ns]
    assert time.counters["missing"] == (now_us - late_us[-1]) // 1_250 - 1
    with pytest.raises(DeviceError, match="it was reset"):
        time.stamps([0], woken_ns + 2_000_000)


class Bytes:
    """A device that sends what it is told, every 1.25 ms."""

    def __init__(self, frame: Callable[[int], bytes]) -> None:
        self._frame, self._sent = frame, 0

    def receive(self, data: bytes, t_s: float) -> None: ...

    def advance(self, t_s: float) -> bytes:
        found = b""
        while (self._sent + 1) * 0.00125 <= t_s:
            found += self._frame(self._sent)
            self._sent += 1
        return found

    faults = ()

    def provoke(self, fault: str) -> None: ...


def test_no_number_is_no_measurement() -> None:
    frame = BotaFrame(0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0, 25.0)
    numbers = [1.0, nan, 1e38, 9.6, 9.4]  # of +-10
    port = Port(Bytes(lambda n: encode(frame._replace(t_us=n * 1250, fz_n=numbers[n % 5]))), BAUD)
    with opened(port) as driver:
        got = {(round(force_n, 6), *rest) for force_n, *rest, _ in port.played(driver, 0.1)}
    assert got == {
        (1.0, 1_000_000, True),
        (0.0, 0, False),
        (10.0, (1 << 63) - 1, False),
        (9.6, 9_600_000, False),
        (9.4, 9_400_000, True),
    }


def refusal(port: Port, settings: BotaSettings = SETTINGS) -> str:
    with pytest.raises(DeviceSetupError) as refused, opened(port, settings):
        pass
    said = str(refused.value)
    assert "\n" not in said
    return said


def test_what_is_no_bota_cell_is_said_in_one_line() -> None:
    assert "nothing comes within 1" in refusal(Port(Bytes(lambda _: b""), BAUD))
    junk = Port(Bytes(lambda n: b"\xaa%06d\r\n" % n), BAUD)
    assert "wrong baud or another device" in refusal(junk)
    slow = SETTINGS.model_copy(update={"rate_hz": 400.0})
    assert "rate_hz = 400: 800 Hz measured" in refusal(Port(device(), BAUD), slow)


def calibrated(folder: Path, serial: str) -> BotaSettings:
    path = folder / "calibration.yaml"
    path.write_text(CALIBRATION.format(serial=serial))
    return SETTINGS.model_copy(update={"calibration": path, "sign": -1})


def test_a_calibration_of_this_device_is_applied(tmp_path: Path) -> None:
    port = Port(device(lambda _: 1.25), BAUD)
    with opened(port, calibrated(tmp_path, "B-17")) as driver:
        (reading, *_) = driver.read(0, None)
        assert reading[:3] == (-2.0, 1_250_000, True)


def test_a_calibration_of_another_device_is_refused(tmp_path: Path) -> None:
    assert "serial = 'X-1'" in refusal(Port(device(), BAUD), calibrated(tmp_path, "X-1"))


def test_a_calibration_needs_a_serial_number_and_the_ports_own_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = calibrated(tmp_path, "B-17")
    said = refusal(Port(device(), BAUD), settings.model_copy(update={"serial": None}))
    assert "no serial number to check it by; expected load_cell.serial, the number on the device's" in said
    monkeypatch.setattr("forefeel.devices.shared.serial_cell.port_serial", lambda _: "FT-9")
    assert "serial = 'B-17': expected 'FT-9', the port's own, or none" in refusal(Port(device(), BAUD))
    with opened(Port(device(), BAUD), SETTINGS.model_copy(update={"serial": None})) as driver:
        assert driver.link.serial == "FT-9"


@pytest.mark.parametrize(
    ("faults", "befallen"),
    [(Faults(drop=0.01), "dropped"), (Faults(delay=0.002), "delayed"), (Faults(0, 0.01, 0.05), "corrupted")],
)
def test_lost_frames_are_missing_and_late_ones_are_not(faults: Faults, befallen: str) -> None:
    port = Port(device(noise_n=0.002), BAUD, faults)
    with opened(port) as driver:
        before, sent = driver.link.counters.copy(), port.line.damaged.counts.copy()
        got = [reading for _ in range(5) for reading in port.played(driver, 1.0)]
        port.time.run(0.1)
        counters, wire = driver.link.counters - before, port.line.damaged.counts - sent
        assert wire[befallen] > 2
        assert counters["missing"] == wire["dropped"] + wire["corrupted"]
        assert counters["junk_bytes"] == 37 * wire["corrupted"] and counters["faults"] == 0
        assert all(reading.valid for reading in got)
