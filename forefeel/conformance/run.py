"""Runs the checks of one driver and shows each."""

import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal, Self

from rich.text import Text

from forefeel.calibrate.prompt import Prompt
from forefeel.common.clock import MonotonicClock
from forefeel.common.errors import ConfigurationError, ForefeelError, RunError
from forefeel.common.hardware.driver import InstalledDriver, every_driver
from forefeel.common.runtime.realtime import prepare_thread
from forefeel.conformance.checks import CHECKS, BrokenError, DriverUnderTest, NotTested
from forefeel.conformance.emulators import EmulatedBench
from forefeel.daemon_settings import load_daemon
from forefeel.interrupt import breakable, heeded
from forefeel.probe.configured import configured
from forefeel.terminal import answer, show

Verdict = Literal["kept", "broken", "not tested"]
_MEMORY = "/dev/shm" if Path("/dev/shm").is_dir() else None  # an emulated device waits for no disk
# s of lateness of the host, from which drivers may find a device silent: they wait 60 ms and more
_LATE_S = 0.05
_LOOK_S = 0.005  # s between two looks at the lateness; chosen, not measured: far below what counts
_PRIORITY = 50  # of SCHED_FIFO, as the loops of the daemons have it
_STYLES = {"kept": "green", "broken": "red", "not tested": "dim"}


@dataclass(frozen=True)
class Checked:
    """One promise of the port."""

    check: str
    verdict: Verdict
    said: str


@dataclass(frozen=True)
class DriverTestOptions:
    """What the user asked for. `config`: the YAML file of a real device; None: the emulator."""

    name: str
    config: Path | None
    axis: str | None
    moves: bool
    yes: bool


def run_driver_test(options: DriverTestOptions) -> None:
    """Makes every check.

    Raises:
        InputError: no such driver, or no emulator of it. RunError: a promise is broken, or the user ended it.
    """
    driver = _driver(options)
    found: list[Checked] = []
    with (
        heeded(lambda: None),
        breakable(lambda: f"interrupted after {len(found)} of {len(CHECKS)} checks"),
        _bench(driver, options) as bench,
    ):
        prepare_thread(_PRIORITY)  # the driver's threads inherit it, as they do in a daemon
        with _Lateness() as lateness:
            for name in CHECKS:
                found.append(_checked(name, bench, lateness))
                show(_in_words(found[-1]))
    about = {"driver": driver.name, "slot": driver.slot, "distribution": driver.distribution}
    document = {"schema": "forefeel.driver_test/1", **about, "version": driver.version}
    answer(document=lambda: {**document, "checks": [asdict(each) for each in found]})
    broken = [each for each in found if each.verdict == "broken"]
    if broken:
        raise RunError("; ".join(f"{each.check}: {each.said}" for each in broken))


def _driver(options: DriverTestOptions) -> InstalledDriver:
    hardware = [driver for driver in every_driver() if driver.driver.settings.hardware]
    found = next((driver for driver in hardware if driver.name == options.name), None)
    if found is None:
        names = ", ".join(sorted(driver.name for driver in hardware))
        raise ConfigurationError(f"{options.name!r}: expected one of {names}; `forefeel devices` lists them")
    if options.config is None and found.driver.emulator is None:
        raise ConfigurationError(f"{options.name}: has no emulator; expected --config FILE of a real device")
    return found


@contextmanager
def _bench(driver: InstalledDriver, options: DriverTestOptions) -> Iterator[DriverUnderTest]:
    clock = MonotonicClock()
    if options.config is not None:
        device = next(
            (
                each
                for each in configured(load_daemon(options.config))
                if each.driver.name == driver.name and options.axis in (None, each.axis)
            ),
            None,
        )
        if device is None:
            raise ConfigurationError(f"{options.config}: no axis has driver {driver.name!r}")
        if options.moves:
            Prompt(options.yes).agree(
                f"{device.name} on {device.where} will move by 1 mm: take out the instrument, clear the way, "
                "keep the stop at hand"
            )
        yield DriverUnderTest(driver, device.settings, None, options.moves, clock)
        return
    with tempfile.TemporaryDirectory(prefix="forefeel-", dir=_MEMORY) as folder, ExitStack() as leave:
        emulated = EmulatedBench(driver, Path(folder), leave)
        yield DriverUnderTest(driver, emulated.settings, emulated, True, clock)


class _Lateness:
    """How late a thread of the drivers' priority wakes up; a late host tells nothing of a driver."""

    def __init__(self) -> None:
        self._worst_s, self._ended = 0.0, threading.Event()
        self._thread = threading.Thread(target=self._look, name="lateness", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def taken_s(self) -> float:
        """The worst since the last call."""
        worst_s, self._worst_s = self._worst_s, 0.0
        return worst_s

    def _look(self) -> None:
        while not self._ended.is_set():
            before_s = time.monotonic()
            time.sleep(_LOOK_S)
            self._worst_s = max(self._worst_s, time.monotonic() - before_s - _LOOK_S)


def _checked(name: str, bench: DriverUnderTest, lateness: _Lateness) -> Checked:
    lateness.taken_s()
    try:
        return Checked(name, "kept", CHECKS[name](bench))
    except NotTested as reason:
        return Checked(name, "not tested", str(reason))
    except (BrokenError, ForefeelError) as error:
        said = str(error) if isinstance(error, BrokenError) else f"DeviceError: {error}"
    late_s = lateness.taken_s()
    if late_s > _LATE_S:
        return Checked(name, "not tested", f"this host was late by {1e3 * late_s:.0f} ms; {said}")
    return Checked(name, "broken", said)


def _in_words(found: Checked) -> Text:
    return Text(f"{found.check}: ").append(found.verdict, _STYLES[found.verdict]).append(f"; {found.said}")
