"""`forefeel device probe`: talks to each device for a while and says what it is and how quickly it answers.

Nothing is ever moved, rendered or re-armed: only `open`, `read` and `close` are called.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from rich.text import Text

from forefeel.common.clock import MonotonicClock, SleepingClock
from forefeel.common.errors import DeviceError, ForefeelError, InputError, RunError
from forefeel.common.hardware.link import DeviceLink
from forefeel.daemon_settings import load_daemon
from forefeel.devices.shared.stream import latency_warning
from forefeel.interrupt import breakable
from forefeel.probe.configured import ConfiguredDevice, configured
from forefeel.terminal import answer, show

_PERIOD_NS = 1_000_000  # ns between two reads: the 1 kHz of the loops
_SWINGS = 20.0
"""By so many times the usual change between two readings a force swings that somebody let go."""
_LEAST_READINGS = 20
Verdict = Literal["ready", "simulated", "refused", "failed"]


@dataclass(frozen=True, slots=True)
class Quantiles:
    p50_ms: float
    p99_ms: float


@dataclass(frozen=True, slots=True)
class Probed:
    """What was found. `rate_hz`: readings or exchanges a second; `round_trip`: from question to answer;
    `age`: of a reading when the 1 kHz loop gets it; `filter_lag_s`: see `filter_lag_s`. None: the device does
    not let one measure it. `warning`: of a slow latency timer.
    """

    axis: str
    slot: str
    driver: str
    where: str
    verdict: Verdict
    error: str | None = None
    warning: str | None = None
    identity: str = ""
    serial: str = ""
    link: str = ""
    rate_hz: float | None = None
    expected_hz: float | None = None
    round_trip: Quantiles | None = None
    age: Quantiles | None = None
    filter_lag_s: float | None = None
    invalid: int = 0
    counters: dict[str, int] = field(default_factory=dict)


def probe(device: ConfiguredDevice, seconds: float, clock: SleepingClock) -> Probed:
    """Opens a device, reads it at 1 kHz for that time and closes it; never raises for a device's fault."""
    found = Probed(device.axis, device.driver.slot, device.driver.name, device.where, "simulated")
    if not device.settings.hardware:
        return found
    driver = None
    try:
        driver = device.driver.make(device.settings, clock)
        try:
            driver.open()
            measured = _read(driver, found.slot == "load_cell", round(seconds * 1e9), clock)
        finally:
            state = "inhibited" if driver.link.inhibited else driver.link.state.name.lower()
            driver.close()
    except ForefeelError as error:
        verdict: Verdict = "refused" if isinstance(error, InputError) else "failed"
        found = replace(found, verdict=verdict, error=str(error))
    else:
        found = replace(found, verdict="ready", **measured)
    if driver is None:
        return found
    port = device.serial_port
    counters = {name: count for name, count in sorted(driver.link.counters.items()) if count}
    return replace(
        found,
        warning=None if port is None else latency_warning(port),
        identity=driver.link.identity,
        serial=driver.link.serial,
        link=state,
        expected_hz=getattr(device.settings, "rate_hz", None),
        counters=counters,
    )


def _read(driver: Any, is_load_cell: bool, span_ns: int, clock: SleepingClock) -> dict[str, Any]:  # noqa: ANN401
    """What was measured, as `Probed` has it; raises what the driver does, or DeviceError: no reading."""
    link: DeviceLink = driver.link  # a driver may begin a new one when it is opened
    link.round_trips_ns.drain()
    if is_load_cell:
        driver.read(clock.now_ns(), None)  # what has queued since it is ready
    stamps_ns, ages_ns, invalid, round_trips_ns = list[int](), list[int](), 0, list[int]()
    forces_n = list[float]()
    start_ns, before = clock.now_ns(), link.exchanges
    now_ns = start_ns
    while now_ns - start_ns < span_ns:
        clock.sleep_until_ns(now_ns + _PERIOD_NS)
        now_ns = clock.now_ns()
        for reading in driver.read(now_ns, None) if is_load_cell else ():
            stamps_ns.append(now_ns if reading.stamp_ns is None else reading.stamp_ns)
            ages_ns.append(now_ns - stamps_ns[-1])
            forces_n.append(reading.force_n)
            invalid += not reading.valid
        if not is_load_cell:
            driver.read(now_ns)
        round_trips_ns += link.round_trips_ns.drain()
    link.require_ready()
    if is_load_cell and not stamps_ns:
        raise DeviceError(f"no reading within {span_ns * 1e-9:.3g} s; expected at least one")
    rate_hz = (link.exchanges - before) * 1e9 / (now_ns - start_ns) or None
    if stamps_ns and stamps_ns[-1] > stamps_ns[0]:
        rate_hz = (len(stamps_ns) - 1) * 1e9 / (stamps_ns[-1] - stamps_ns[0])
    times = {"round_trip": _quantiles(round_trips_ns), "age": _quantiles(ages_ns)}
    return {
        "rate_hz": rate_hz,
        "invalid": invalid,
        "filter_lag_s": filter_lag_s(stamps_ns, forces_n),
        **times,
    }


def filter_lag_s(stamps_ns: list[int], forces_n: list[float]) -> float | None:
    """Time constant of a first-order filter whose answer to a step has this swing over its steepest slope.

    Of a force that nobody let go it says nothing: None. What is let go slowly makes it larger, never smaller.
    """
    changes_n = np.abs(np.diff(forces_n))
    if len(forces_n) < _LEAST_READINGS or not changes_n.any():
        return None
    swing_n = float(np.ptp(forces_n))
    count_n = changes_n[changes_n > 0.0].min()
    if swing_n < _SWINGS * max(count_n, np.quantile(changes_n, 0.5)):
        return None
    spans_s = np.diff(stamps_ns) * 1e-9  # of a batch that came at once: half of the mean at least
    return swing_n / float(np.max(changes_n / np.maximum(spans_s, 0.5 * spans_s.mean())))


def _quantiles(times_ns: list[int]) -> Quantiles | None:
    return Quantiles(*(1e-6 * np.quantile(times_ns, (0.5, 0.99))).tolist()) if times_ns else None


# --- the command ---

_STYLES = {"ready": "green", "simulated": "dim", "refused": "red", "failed": "red"}


def run_probe(config: Path, seconds: float) -> None:
    """Probes one device after the other and shows each as it was found.

    Raises:
        InputError: the file, or a device that is not the one that it names.
        RunError: a device failed while it was probed, or the user ended it.
    """
    devices = configured(load_daemon(config))
    found: list[Probed] = []
    with breakable("probe interrupted; what was found is above"):
        for device in devices:
            found.append(probe(device, seconds, MonotonicClock()))
            show(_in_words(found[-1]))
    answer(
        document=lambda: {"schema": "forefeel.device_probe/1", "devices": [asdict(each) for each in found]}
    )
    _raise_worst(found)


def _in_words(found: Probed) -> Text:
    head = f"{found.axis} {found.slot}: {found.driver}{f' on {found.where}' if found.where else ''}: "
    return Text(head).append(found.verdict, _STYLES[found.verdict]).append("; ".join(_facts(found)))


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
        for what, times in (("round trip", found.round_trip), ("age", found.age)):
            if times is not None:
                yield f"{what} p50 {times.p50_ms:.3g} ms, p99 {times.p99_ms:.3g} ms"
        if found.filter_lag_s is not None:
            yield f"filter lag {found.filter_lag_s * 1e3:.2g} ms"
        if found.invalid:
            yield f"{found.invalid} readings not valid"
        if found.warning:
            yield found.warning
    yield f"link {found.link}"
    yield ", ".join(f"{count} {name}" for name, count in found.counters.items()) or "nothing counted"


def _raise_worst(found: list[Probed]) -> None:
    """Exit 2 for what the configuration has wrong, before 1 for what failed; the first is said in full."""
    for verdict, kind in (("refused", InputError), ("failed", RunError)):
        bad = [each for each in found if each.verdict == verdict]
        if bad:
            more = "".join(f"; {each.axis} {each.slot}: {each.error}" for each in bad[1:])
            raise kind(f"{bad[0].axis} {bad[0].slot}: {bad[0].error}{more}")
