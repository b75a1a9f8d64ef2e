"""Lines of numbers, and their driver against the emulated cell: streaming and asked."""

from contextlib import AbstractContextManager
from pathlib import Path

import pytest

from forefeel.common.errors import DeviceError, DeviceSetupError
from forefeel.devices.ascii_line.driver import AsciiLineLoadCell
from forefeel.devices.ascii_line.emulator import EmulatedLineCell
from forefeel.devices.ascii_line.protocol import NEWTON_PER_UNIT, LineParser, Unit, parse_line
from forefeel.devices.ascii_line.settings import AsciiLineSettings
from forefeel.devices.emulation.sensing import EmulatedSensor
from forefeel.devices.emulation.wire import EmulatedDevice
from forefeel.devices.shared.force_scale import StuckWatch
from tests.devices.cell_bench import NAME, NOW_S, Port, stamp_s
from tests.devices.test_bota import CALIBRATION, Bytes, slope
from tests.emulators.damage import Faults


def numbers(parser: LineParser, data: bytes) -> list[float]:
    return [line.number for line in parser.feed(data)]


def begun() -> LineParser:
    parser = LineParser("newton")
    parser.begin()
    return parser


@pytest.mark.parametrize(
    ("line", "unit", "number"),
    [
        (b"1.25", "newton", 1.25),
        (b" -0.5 N ", "newton", -0.5),
        (b"+3", "newton", 3.0),
        (b"2345", "millipound_force", 2345.0),
        (b"HX711 reading: 8400", "counts", 8400.0),
        (b"-8388608", "counts", -8388608.0),
        (b"12 N", "counts", None),
        (b"1.2.3", "newton", None),
        (b"1.2 1.3", "newton", None),
        (b"one reading:\t1.2\t| average:\t1.1", "counts", None),
        (b"nan", "newton", None),
        (b"inf", "newton", None),
        (b"1e5", "newton", None),
        (b"A", "millipound_force", None),
        (b"1234567890123", "counts", None),
        ("１２".encode(), "newton", None),
        (b"\xff12", "newton", None),
    ],
)
def test_lines(line: bytes, unit: Unit, number: float | None) -> None:
    assert parse_line(line, unit) == number


def test_the_first_line_is_cut_and_dropped() -> None:
    parser = LineParser("newton")
    assert numbers(parser, b"5\r\n1.5\r\n2.5\r") == [1.5, 2.5]
    assert parser.counters == {"junk_lines": 1, "junk_bytes": 1, "lines": 2}


def test_an_endless_line_is_bounded_and_counted() -> None:
    parser = begun()
    for _ in range(1000):
        assert parser.feed(b"1" * 50) == []
        assert len(parser._buffer) <= 64
    assert numbers(parser, b"1\r\n2.5\r\n") == [2.5]
    assert parser.counters["junk_bytes"] == 50_001


def test_two_lines_that_lost_their_end_are_no_number() -> None:
    parser = begun()
    assert numbers(parser, b"12.50001.2500\r\n3.0000\r\n") == [3.0]
    assert parser.counters["junk_lines"] == 1


MILLIPOUND_N = NEWTON_PER_UNIT["millipound_force"]
COUNTS = {"unit": "counts", "full_scale_native": 2_000_000}


def loadstar() -> EmulatedLineCell:
    return EmulatedLineCell(EmulatedSensor(slope, 150.0, noise_n=0.0), "millipound_force", "O0W1")


def hx711(noise_n: float = 0.002) -> EmulatedLineCell:
    return EmulatedLineCell(EmulatedSensor(slope, 80.0, noise_n=noise_n), "counts")


def settings(**more: object) -> AsciiLineSettings:
    given = {
        "driver": "ascii_line",
        "port": NAME,
        "baud": 115_200,
        "full_scale_n": 10.0,
        "unit": "millipound_force",
        "serial": "L-4",
    }
    return AsciiLineSettings.model_validate({**given, **more})


def opened(port: Port, chosen: AsciiLineSettings) -> AbstractContextManager[AsciiLineLoadCell]:
    return port.opened(lambda time: AsciiLineLoadCell(chosen, time))


def port(device: EmulatedDevice, hub_s: float = 0.0, faults: Faults | None = None) -> Port:
    return Port(device, 115_200, faults, hub_s)


@pytest.mark.parametrize("hub_s", [0.0, 0.016])
def test_a_loadstar_that_is_asked_answers_once_a_period(hub_s: float) -> None:
    bench = port(loadstar(), hub_s=hub_s)
    with opened(bench, settings(request="O0W1", rate_hz=20)) as driver:
        got = [reading for _ in range(3) for reading in bench.played(driver, 1.0)]
        assert len(got) == pytest.approx(60, abs=1)
        assert driver.link.counters["unanswered"] == 0
        for reading in got:
            assert reading.valid
            true_n = slope(stamp_s(reading))
            assert reading.force_n == pytest.approx(true_n, abs=MILLIPOUND_N + 0.1 * (1 / 150 + hub_s))
            assert reading.raw_counts == round(reading.force_n * 1e6)


def test_an_unanswered_request_is_counted_and_asked_again() -> None:
    bench = port(loadstar(), faults=Faults(drop=0.05))
    with opened(bench, settings(request="O0W1", rate_hz=20)) as driver:
        dropped, asked = bench.line.damaged.counts["dropped"], driver.link.counters["unanswered"]
        bench.time.run(10.0)
        assert driver.link.inhibited is None
        assert bench.line.damaged.counts["dropped"] - dropped > 3
        missed = driver.link.counters["unanswered"] - asked
        assert missed == pytest.approx(bench.line.damaged.counts["dropped"] - dropped, abs=1)


def calibration(folder: Path) -> Path:
    path = folder / "counts.yaml"
    text = (
        CALIBRATION.format(serial="L-4")
        .replace("bota_serial", "ascii_line")
        .replace("gain_n: 2.0", "gain_n: 5.0e-6")
    )
    path.write_text(text.replace("zero: 0.25", "zero: 84000.0"))
    return path


def test_counts_of_an_hx711_with_its_calibration(tmp_path: Path) -> None:
    device = hx711(noise_n=0.0)
    bench = port(device)
    with opened(bench, settings(**COUNTS, calibration=calibration(tmp_path))) as driver:
        driver.read(0, None)
        for reading in bench.played(driver, 1.0):
            assert reading.valid
            assert reading.force_n == pytest.approx(slope(stamp_s(reading)), abs=0.1 * 0.001)
            assert reading.raw_counts == pytest.approx(84_000 + 200_000 * reading.force_n)
        device.provoke("overrange")
        *_, last = bench.played(driver, 0.5)
        assert last[:3] == (10.0, (1 << 23) - 1, False)
        assert driver.link.counters["overrange"] > 30


def test_counts_without_a_calibration_are_no_force_but_can_be_calibrated() -> None:
    bench = port(hx711())
    with bench.made(lambda time: AsciiLineLoadCell(settings(**COUNTS), time)) as driver:
        with pytest.raises(DeviceSetupError, match="'counts' without calibration"):
            driver.open()
        driver.open_native()
        bench.time.run(0.5)
        got = driver.read_native(0)
        assert len(got) > 30 and got[-1].valid
        expected = 84_000 + 200_000 * slope(got[-1].stamp_ns * 1e-9 - NOW_S)
        assert got[-1].native == pytest.approx(expected, abs=3000)
        with pytest.raises(DeviceError, match="native"):
            driver.read(0, None)


def test_what_is_no_cell_is_said_in_one_line() -> None:
    for device, chosen, said in (
        (Bytes(lambda _: b""), settings(request="O0W1"), "nothing comes within 1.1 s"),
        (
            Bytes(lambda _: b"\x80\x99"),
            settings(),
            "but nothing of the expected lines of numbers at 115200 baud",
        ),
        (loadstar(), settings(request="SSX"), "lines of numbers, asked by 'SSX'"),
        (hx711(), settings(rate_hz=10), "rate_hz = 10: 80"),
    ):
        with pytest.raises(DeviceSetupError) as refused, opened(port(device), chosen):
            pass
        assert said in str(refused.value)
        assert "\n" not in str(refused.value)


def test_damaged_lines_are_counted_or_numbers() -> None:
    bench = port(hx711(), faults=Faults(corrupt=0.05))
    with opened(bench, settings(unit="newton", full_scale_n=10_000.0)) as driver:
        bench.time.run(30.0)
        counters = driver.link.counters
        assert counters["junk_lines"] > 20
        lost = bench.line.damaged.counts["chunks"] - counters["lines"]
        assert lost <= 2 * counters["junk_lines"], "where the end of a line is damaged, two are lost"
        assert counters["junk_lines"] <= 2 * bench.line.damaged.counts["corrupted"] + 1


def test_lines_that_are_late_or_in_parts_are_whole() -> None:
    bench = port(hx711(), faults=Faults(split=0.5, delay=0.05))
    with opened(bench, settings(unit="newton", full_scale_n=1e4)) as driver:
        before, junk = driver.link.counters["lines"], driver.link.counters["junk_lines"]
        sent = bench.line.damaged.counts.copy()
        bench.time.run(5.0)
        wire = bench.line.damaged.counts - sent
        assert wire["split"] > 100 and wire["delayed"] > 10
        assert driver.link.counters["lines"] - before == pytest.approx(wire["chunks"], abs=2)  # under way
        assert junk <= 1 and driver.link.counters["junk_lines"] == junk  # the first one is cut
        assert driver.link.counters["faults"] == 0


def repeats(values: list[float], noisy: bool) -> list[bool]:
    watch = StuckWatch(noisy)
    return [watch.take(value, n / 80) for n, value in enumerate(values)]


def test_only_who_was_noisy_is_said_to_stick() -> None:
    noise = [float(n * 7919 % 13) for n in range(200)]
    coarse = [float(n // 8) for n in range(200)]  # a slow motion on a coarse cell
    flicker = [float(n % 25 == 0) for n in range(200)]
    assert not any(repeats(noise, False))
    assert repeats(noise + [3.5] * 200, False).index(True) == 200 + 80
    assert not any(repeats([*noise, *([3.5] * 79), *noise], False))
    for quiet in (coarse, flicker, [0.0] * 200):
        assert not any(repeats(quiet + [3.5] * 400, False))
