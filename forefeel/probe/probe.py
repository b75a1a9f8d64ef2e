"""`forefeel device probe`: talks to each device for a while and says what it is and how quickly it answers.

Nothing is ever moved, rendered or re-armed: only `open`, `read` and `close` are called.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from rich.text import Text

from forefeel.common.clock import MonotonicClock, SleepingClock
from forefeel.common.errors import ConfigurationError, DeviceError, ForefeelError, InputError, RunError
from forefeel.common.hardware.link import DeviceLink
from forefeel.daemon_settings import load_daemon
from forefeel.devices.shared.stream import latency_warning
from forefeel.interrupt import breakable, heeded
from forefeel.probe.configured import ConfiguredDevice, configured
from forefeel.terminal import answer, show

_PERIOD_NS = 1_000_000  # ns between two reads: the 1 kHz of the loops
Verdict = Literal["ready", "simulated", "refused", "failed"]


@dataclass(frozen=True, slots=True)
class Quantiles:
    p50_ms: float
    p99_ms: float


@dataclass(frozen=True, slots=True)
class Probed:
    """What was found. `rate_hz`: readings or exchanges a second; `round_trip`: from question to answer;
    `age`: of a reading when the 1 kHz loop gets it. None: the device does not let one measure it.
    """

    axis: str
    slot: str
    driver: str
    where: str
    verdict: Verdict
    error: str | None = None
    identity: str = ""
    serial: str = ""
    link: str = ""
    rate_hz: float | None = None
    expected_hz: float | None = None
    round_trip: Quantiles | None = None
    age: Quantiles | None = None
    invalid: int = 0
    counters: dict[str, int] = field(default_factory=dict)


def probe(device: ConfiguredDevice, seconds: float, clock: SleepingClock) -> Probed:
    """Opens a device, reads it at 1 kHz for that time and closes it; never raises for a device's fault."""
    about = (device.axis, device.driver.slot, device.driver.name, device.where)
    if not device.settings.hardware:
        return Probed(*about, "simulated")
    driver, tally = None, _Tally()
    verdict: Verdict = "ready"
    error = None
    try:
        driver = device.driver.make(device.settings, clock)
        tally.run(driver, device.driver.slot == "load_cell", round(seconds * 1e9), clock)
    except ForefeelError as caught:
        verdict, error = ("refused" if isinstance(caught, InputError) else "failed"), str(caught)
    link: DeviceLink = driver.link if driver is not None else DeviceLink("")
    return Probed(
        *about,
        verdict,
        error,
        link.identity,
        link.serial,
        tally.state,
        tally.rate_hz,
        getattr(device.settings, "rate_hz", None),
        _quantiles(tally.round_trips_ns),
        _quantiles(tally.ages_ns),
        tally.invalid,
        dict(sorted((name, count) for name, count in link.counters.items() if count)),
    )


class _Tally:
    def __init__(self) -> None:
        self.state = "closed"
        self.rate_hz: float | None = None
        self.round_trips_ns: list[int] = []
        self.ages_ns: list[int] = []
        self.invalid = 0
        self._stamps_ns: list[int] = []

    def run(self, driver: Any, is_load_cell: bool, span_ns: int, clock: SleepingClock) -> None:  # noqa: ANN401
        """Raises what the driver does, and DeviceError for a load cell without a reading."""
        try:
            driver.open()
            link: DeviceLink = driver.link  # a driver may begin a new one when it is opened
            link.round_trips_ns.drain()
            if is_load_cell:
                driver.read(clock.now_ns(), None)  # what has queued since it is ready
            start_ns, before = clock.now_ns(), link.exchanges
            now_ns = start_ns
            while now_ns - start_ns < span_ns:
                clock.sleep_until_ns(now_ns + _PERIOD_NS)
                now_ns = clock.now_ns()
                if is_load_cell:
                    self._take(driver.read(now_ns, None), now_ns)
                else:
                    driver.read(now_ns)
                self.round_trips_ns += link.round_trips_ns.drain()
            link.require_ready()
            self._rate(link.exchanges - before, now_ns - start_ns, is_load_cell)
        finally:
            self.state = "inhibited" if driver.link.inhibited else driver.link.state.name.lower()
            driver.close()

    def _take(self, readings: Any, now_ns: int) -> None:  # noqa: ANN401
        for reading in readings:
            stamp_ns = now_ns if reading.stamp_ns is None else reading.stamp_ns
            self._stamps_ns.append(stamp_ns)
            self.ages_ns.append(now_ns - stamp_ns)
            self.invalid += not reading.valid

    def _rate(self, exchanges: int, span_ns: int, is_load_cell: bool) -> None:
        if is_load_cell and not self._stamps_ns:
            raise DeviceError(f"no reading within {span_ns * 1e-9:.3g} s; expected at least one")
        if len(self._stamps_ns) > 1 and self._stamps_ns[-1] > self._stamps_ns[0]:
            self.rate_hz = (len(self._stamps_ns) - 1) * 1e9 / (self._stamps_ns[-1] - self._stamps_ns[0])
        elif exchanges:
            self.rate_hz = exchanges * 1e9 / span_ns


def _quantiles(times_ns: list[int]) -> Quantiles | None:
    if not times_ns:
        return None
    ordered = sorted(times_ns)
    p50, p99 = (ordered[min(len(ordered) - 1, int(share * len(ordered)))] for share in (0.5, 0.99))
    return Quantiles(p50 * 1e-6, p99 * 1e-6)


# --- the command ---

_STYLES = {"ready": "green", "simulated": "dim", "refused": "red", "failed": "red"}


def run_probe(config: Path, seconds: float, clock: SleepingClock | None = None) -> None:
    """Probes one device after the other and shows each as it was found.

    Raises:
        InputError: the file, or a device that is not the one that it names.
        RunError: a device failed while it was probed, or the user ended it.
    """
    if not 0.05 <= seconds <= 3600.0:
        raise ConfigurationError(f"--seconds {seconds:g}: expected 0.05 to 3600 s")
    devices = configured(load_daemon(config))
    found: list[Probed] = []
    with (
        heeded(),
        breakable(lambda: f"probe interrupted after {len(found)} of {len(devices)} devices"),
    ):
        for device in devices:
            found.append(probe(device, seconds, clock or MonotonicClock()))
            show(*_in_words(found[-1], device.serial_port))
    answer(
        document=lambda: {"schema": "forefeel.device_probe/1", "devices": [asdict(each) for each in found]}
    )
    _raise_worst(found)


def _in_words(found: Probed, port: str | None) -> Iterator[Text]:
    head = f"{found.axis} {found.slot}: {found.driver}{f' on {found.where}' if found.where else ''}: "
    verdict = Text(head).append(found.verdict, _STYLES[found.verdict])
    yield verdict.append("; ".join(_facts(found)))
    warning = latency_warning(port) if port else None
    if warning:
        yield Text(f"  {warning}", style="yellow")


def _facts(found: Probed) -> Iterator[str]:
    """What follows the verdict; the reason of a refusal is said at the end, on stderr."""
    if found.verdict == "simulated":
        return
    yield ""
    if found.identity:
        yield found.identity
    if found.verdict == "ready":
        expected = "" if found.expected_hz is None else f" of {found.expected_hz:g}"
        yield "rate not told" if found.rate_hz is None else f"{found.rate_hz:.4g}{expected} Hz"
        yield from _times("round trip", found.round_trip)
        yield from _times("age", found.age)
        if found.invalid:
            yield f"{found.invalid} readings not valid"
    yield f"link {found.link}"
    counted = ", ".join(f"{count} {name}" for name, count in found.counters.items())
    yield counted or "nothing counted"


def _times(what: str, times: Quantiles | None) -> Iterator[str]:
    if times is not None:
        yield f"{what} p50 {times.p50_ms:.3g} ms, p99 {times.p99_ms:.3g} ms"


def _raise_worst(found: list[Probed]) -> None:
    """Exit 2 for what the configuration has wrong, before 1 for what failed; the first is said in full."""
    for verdict, kind in (("refused", InputError), ("failed", RunError)):
        bad = [each for each in found if each.verdict == verdict]
        if bad:
            more = "".join(f"; {each.axis} {each.slot}: {each.error}" for each in bad[1:])
            raise kind(f"{bad[0].axis} {bad[0].slot}: {bad[0].error}{more}")
