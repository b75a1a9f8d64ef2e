"""The Inverse3's driver against a mock of its maker's service, in stepped time."""

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import inf, nan

import pytest

from forefeel.common.config import checked
from forefeel.common.errors import ConfigurationError, DeviceError, DeviceSetupError
from forefeel.common.hardware.link import LinkState
from forefeel.common.messages import Grip
from forefeel.devices.haply import driver
from forefeel.devices.haply.driver import HaplyHandle
from forefeel.devices.haply.settings import HaplySettings
from forefeel.testing import SteppedTime, stepped
from tests.emulators.haply_service import HaplyService

URL = "ws://localhost:10001"


class Bench:
    """A handle on the mock, whose haptic loop renders `force_n` each ms.

    Attributes:
        gone: whether nobody listens; `hangs`: whether the haptic loop stands still.
    """

    def __init__(self, time: SteppedTime, **changes: object) -> None:
        self.time, self.service = time, HaplyService()
        self.gone = self.hangs = False
        self.force_n = self.applied_n = 0.0
        self.handle = HaplyHandle(
            checked(HaplySettings, {"driver": "haply", "direction": [0, 0, -1], **changes}, "test"), time
        )

    def tick(self, now_ns: int) -> None:
        if self.handle.link.state is LinkState.READY and not self.hangs:
            self.applied_n = self.handle.render(self.force_n, now_ns)

    def fallen(self) -> str:
        """Runs until a fault; returns its text."""
        self.time.run_until(lambda: self.handle.link.inhibited, 2.0)
        with pytest.raises(DeviceError) as fault:
            self.handle.read(self.time.now_ns())
        assert "\n" not in str(fault.value)
        return str(fault.value)


@contextmanager
def closed(monkeypatch: pytest.MonkeyPatch, **changes: object) -> Iterator[Bench]:
    """A bench whose handle is not open; each message takes a ms each way."""
    with stepped() as time:
        bench = Bench(time, **changes)

        class Stream:
            """Stands in for `ServiceStream`."""

            def __init__(self, url: str) -> None:
                if bench.gone:
                    raise DeviceSetupError(f"{url}: refused; expected Haply's service to run there")
                self._waiting = deque([bench.service.greeting()])

            def receive(self, timeout_s: float) -> str | None:
                if bench.gone:
                    raise DeviceError(f"{URL}: the service is gone")
                until_ns = time.now_ns() + round(timeout_s * 1e9)
                while not self._waiting and time.now_ns() < until_ns:
                    time.host_hangs(1e-3)
                return self._waiting.popleft() if self._waiting else None

            def send(self, text: str) -> None:
                if bench.gone:
                    raise DeviceError(f"{URL}: the service is gone")
                self._waiting += bench.service.answer(text)

            def close(self) -> None:
                """Nothing is left open."""

        monkeypatch.setattr(driver, "ServiceStream", Stream)
        time.tick = bench.tick
        try:
            yield bench
        finally:
            bench.handle.close()


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    """A bench whose handle is open, in the direction that the device counts down."""
    with closed(monkeypatch) as made:
        made.handle.open()
        yield made


# --- what goes through ---


def test_one_direction_of_three_is_read_and_pushed(bench: Bench) -> None:
    bench.service.position_m, bench.service.velocity_m_s = [0.3, 0.4, -0.02], [1.0, 1.0, -0.1]
    bench.service.buttons = {"a": True, "b": True, "c": False}
    bench.force_n = 1.5
    bench.time.run(0.1)
    reading = bench.handle.read(bench.time.now_ns())
    assert reading.position_m == pytest.approx(0.02, abs=0.1 * 0.01)
    assert reading.velocity_m_s == pytest.approx(0.1)
    assert (reading.deadman, reading.gripper) == (True, Grip.OPEN)
    assert bench.service.force_n == pytest.approx([0.0, 0.0, 1.5])  # against the insertion


def test_forces_go_out_at_the_rate_of_the_settings(bench: Bench) -> None:
    before = bench.service.commands
    bench.time.run(1.0)
    assert bench.service.commands - before == pytest.approx(200, abs=2)
    assert bench.handle.counters["states"] == pytest.approx(bench.service.commands, abs=12)


def test_force_is_clamped_to_the_limit_and_none_without_a_number(bench: Bench) -> None:
    for asked_n, applied_n in ((5.0, 2.0), (-5.0, -2.0), (nan, 0.0), (inf, 0.0)):
        bench.force_n = asked_n
        bench.time.run(0.02)
        assert bench.applied_n == applied_n
        assert bench.service.force_n[2] == pytest.approx(applied_n)


def test_state_is_carried_on_for_two_periods(bench: Bench) -> None:
    bench.service.velocity_m_s = [0.0, 0.0, -0.1]
    bench.time.run(0.1)
    bench.service.silent = True
    bench.time.run(0.03)
    reading = bench.handle.read(bench.time.now_ns())
    assert reading.position_m == pytest.approx(0.1 * 0.01)
    assert reading.velocity_m_s == 0.0


@pytest.mark.parametrize("status", [{"awake": False}, {"connected": False}])
def test_deadman_of_a_grip_that_is_not_there_is_released(bench: Bench, status: dict[str, bool]) -> None:
    bench.service.buttons["a"] = True
    bench.time.run(0.05)
    assert bench.handle.read(bench.time.now_ns()).deadman
    bench.service.grip_status |= status
    bench.time.run_until(
        lambda: bench.handle.link.inhibited or not bench.handle.read(bench.time.now_ns()).deadman, 0.5
    )


def test_close_takes_the_force_away(bench: Bench) -> None:
    bench.force_n = 1.0
    bench.time.run(0.05)
    bench.time.tick = lambda now_ns: None
    bench.handle.close()
    assert bench.service.force_n == [0.0, 0.0, 0.0]


# --- the handshake ---


def absent(bench: Bench) -> None:
    bench.service.present = False


def several(bench: Bench) -> None:
    bench.service.more = [{"device_id": "0500"}]


def asleep(bench: Bench) -> None:
    bench.service.asleep = True


def unpowered(bench: Bench) -> None:
    bench.service.device_status["power_supply"] = False


def uncalibrated(bench: Bench) -> None:
    bench.service.device_status["calibrated"] = False


def without_a_grip(bench: Bench) -> None:
    bench.service.grip = False


def not_running(bench: Bench) -> None:
    bench.gone = True


def mute(bench: Bench) -> None:
    bench.service.present, bench.service.silent = False, True


@pytest.mark.parametrize(
    ("before", "says"),
    [
        (absent, "does not have an Inverse3"),
        (several, "049D, 0500; expected device_id"),
        (asleep, "asleep"),
        (unpowered, "no power"),
        (uncalibrated, "not calibrated"),
        (without_a_grip, "no Verse Grip"),
        (not_running, "expected Haply's service"),
        (mute, "does not have an Inverse3"),
    ],
)
def test_device_that_is_not_fit_is_refused(
    monkeypatch: pytest.MonkeyPatch, before: Callable[[Bench], None], says: str
) -> None:
    with closed(monkeypatch) as bench:
        before(bench)
        with pytest.raises(DeviceSetupError, match=says) as refused:
            bench.handle.open()
        assert "\n" not in str(refused.value)


def test_device_that_was_refused_or_closed_can_be_opened_again(monkeypatch: pytest.MonkeyPatch) -> None:
    with closed(monkeypatch) as bench:
        without_a_grip(bench)
        with pytest.raises(DeviceSetupError):
            bench.handle.open()
        bench.service.grip = True
        for _ in range(2):
            bench.handle.open()
            assert bench.handle.link.state is LinkState.READY
            bench.handle.close()


def test_device_of_the_settings_is_taken_among_several(monkeypatch: pytest.MonkeyPatch) -> None:
    with closed(monkeypatch, device_id="049D") as bench:
        several(bench)
        bench.handle.open()
        assert bench.handle.link.identity == "Inverse3 049D"


# --- faults ---


def given_too_much(bench: Bench) -> None:
    bench.service.given_n = [0.0, 3.0, 0.0]


def no_number(bench: Bench) -> None:
    bench.service.position_m = [nan, 0.0, 0.0]


def silent(bench: Bench) -> None:
    bench.service.silent = True


def still(bench: Bench) -> None:
    bench.force_n = 1.0
    bench.time.run(0.01)
    bench.hangs = True


def unplugged(bench: Bench) -> None:
    bench.service.grip_status["connected"] = False


def swapped(bench: Bench) -> None:
    answer = bench.service.answer
    bench.service.answer = lambda text: [message.replace("049D", "0500") for message in answer(text)]  # type: ignore[method-assign]


def out_of_reach(bench: Bench) -> None:
    bench.service.grip_status["connected"], bench.service.grip_state = False, False


@pytest.mark.parametrize(
    ("fault", "says"),
    [
        (not_running, "the service is gone"),
        (swapped, "0500; expected 049D, as before"),
        (out_of_reach, "no Verse Grip"),
        (asleep, "asleep"),
        (given_too_much, "gives 3 N; expected at most 2 N"),
        (no_number, "no message of the Inverse service"),
        (silent, "no state for"),
        (still, "the haptic loop stands still"),
        (unplugged, "no Verse Grip"),
    ],
)
def test_fault_takes_the_force_away_until_rearmed_with_the_deadman(
    bench: Bench, fault: Callable[[Bench], None], says: str
) -> None:
    bench.service.buttons["a"] = True
    fault(bench)
    assert says in bench.fallen()
    good, bench.force_n = HaplyService(), 0.0
    good.buttons["a"] = True  # held all the time
    good.grip = False  # the service knows the device before its grip
    bench.service, bench.gone, bench.hangs = good, False, False
    bench.time.run_until(lambda: bench.handle.link.state is LinkState.IDENTIFIED)
    bench.time.run(0.1)
    good.grip = True
    bench.time.run_until(lambda: bench.handle.link.state is LinkState.CONFIGURED)
    bench.time.run(0.1)
    assert good.force_n == [0.0, 0.0, 0.0]
    anew = [bench.handle.pressed_anew]
    for held in False, True:
        good.buttons["a"] = held
        bench.time.run(0.05)
        anew.append(bench.handle.pressed_anew)
    assert anew == [False, False, True]
    bench.handle.rearm()
    bench.time.run(0.05)
    assert bench.handle.read(bench.time.now_ns()).deadman


# --- settings ---


@pytest.mark.parametrize(
    "wrong", [{"direction": [0, 0, 0]}, {"url": "localhost:10001"}, {"max_force_n": 11}, {"rate_hz": 10}]
)
def test_settings_that_can_not_be_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ConfigurationError, match=next(iter(wrong))):
        checked(HaplySettings, {"driver": "haply", **wrong}, "test")
