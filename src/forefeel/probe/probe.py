"""`forefeel device probe`: talks to each device for a while; says its identity and how quickly it answers.

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
from forefeel.configured_devices import ConfiguredDevice, configured, require_released
from forefeel.daemon_settings import load_daemon
from forefeel.devices.shared.stream import latency_warning
from forefeel.interrupt import break_off, ends_in_order, signal_flag
from forefeel.terminal import answer, show

_PERIOD_NS = 1_000_000  # ns between two reads: the 1 kHz of the loops
_SWINGS = 20.0  # by so many times the usual change between two readings a force swings that somebody let go
_LEAST_READINGS = 20
Verdict = Literal["ready", "simulated", "refused", "failed"]


@dataclass(frozen=True, slots=True)
class Quantiles:
    p50_ms: float
    p99_ms: float


@dataclass(frozen=True, slots=True)
class Probed:
    """Result of a probe. `rate_hz`: readings or exchanges a second; `round_trip`: from question to answer;
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
    """Opens a device, reads it at 1 kHz for that time and closes it; returns what was measured. A simulated
    device is not opened. A ForefeelError is not raised: it becomes the verdict, `refused` if an InputError,
    else `failed`, and its text `error`.
    """
    result = Probed(device.axis, device.driver.slot, device.driver.name, device.where, "simulated")
    if not device.settings.hardware:
        return result
    driver = None
    try:
        driver = device.driver.make(device.settings, clock)
        try:
            driver.open()
            measured = _measure(driver, result.slot == "load_cell", round(seconds * 1e9), clock)
        finally:
            state = "inhibited" if driver.link.inhibited else driver.link.state.name.lower()
            driver.close()
    except ForefeelError as error:
        verdict: Verdict = "refused" if isinstance(error, InputError) else "failed"
        result = replace(result, verdict=verdict, error=str(error))
    else:
        result = replace(result, verdict="ready", **measured)
    if driver is None:
        return result
    port = device.serial_port
    counters = {name: count for name, count in sorted(driver.link.counters.items()) if count}
    return replace(
        result,
        warning=None if port is None else latency_warning(port),
        identity=driver.link.identity,
        serial=driver.link.serial,
        link=state,
        expected_hz=getattr(device.settings, "rate_hz", None),
        counters=counters,
    )


def _measure(driver: Any, is_load_cell: bool, span_ns: int, clock: SleepingClock) -> dict[str, Any]:  # noqa: ANN401
    """Reads an open device at 1 kHz for that time; returns rate, round trip, age, filter lag and invalid
    readings as fields of `Probed`. `driver`: of a stage, handle or load cell. DeviceError: a fault, or no
    reading.
    """
    link: DeviceLink = driver.link  # a driver may begin a new one when it is opened
    link.round_trips_ns.drain()
    if is_load_cell:
        driver.read(clock.now_ns(), None)  # what has queued since it is ready
    stamps_ns, ages_ns, invalid, round_trips_ns = list[int](), list[int](), 0, list[int]()
    lag_times_ns, forces_n = list[int](), list[float]()
    start_ns, before = clock.now_ns(), link.exchanges
    now_ns = start_ns
    while now_ns - start_ns < span_ns:
        clock.sleep_until_ns(now_ns + _PERIOD_NS)
        now_ns = clock.now_ns()
        for reading in driver.read(now_ns, None) if is_load_cell else ():
            stamps_ns.append(now_ns if reading.stamp_ns is None else reading.stamp_ns)
            ages_ns.append(now_ns - stamps_ns[-1])
            invalid += not reading.valid
            if reading.valid:  # the force of another may be any, often full scale: a step that no filter made
                lag_times_ns.append(stamps_ns[-1])
                forces_n.append(reading.force_n)
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
        "filter_lag_s": filter_lag_s(lag_times_ns, forces_n),
        **times,
    }


def filter_lag_s(stamps_ns: list[int], forces_n: list[float]) -> float | None:
    """Estimates the time constant in s of the cell's filter, if the force was let go: swing over steepest
    slope.

    None with fewer than 20 readings, or where the force swings too little for that. What is let go slowly
    makes it larger, never smaller.
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
    """Probes the devices of a settings file one after the other, prints each result, and raises for the
    worst.

    Raises:
        InputError: the file, its daemon that runs, or a device that is not the one that it names.
        RunError: a device failed while it was probed, or the user ended it.
    """
    devices = configured(load_daemon(config))
    require_released(config)
    results: list[Probed] = []
    with ends_in_order("probe") as printed, signal_flag(break_off):
        printed.append("what was found is above")
        for device in devices:
            results.append(probe(device, seconds, MonotonicClock()))
            show(_in_words(results[-1]))
    answer(document=lambda: {"schema": "forefeel.device_probe/1", "devices": [asdict(p) for p in results]})
    _raise_worst(results)


def _in_words(probed: Probed) -> Text:
    head = f"{probed.axis} {probed.slot}: {probed.driver}{f' on {probed.where}' if probed.where else ''}: "
    return Text(head).append(probed.verdict, _STYLES[probed.verdict]).append("; ".join(_facts(probed)))


def _facts(probed: Probed) -> Iterator[str]:
    """Yields the texts after the verdict: first an empty one, then identity, rate, times, link and counters.
    Nothing for a simulated device; the reason of a refusal comes at the end, on stderr.
    """
    if probed.verdict == "simulated":
        return
    yield ""
    if probed.identity:
        yield probed.identity
    if probed.verdict == "ready":
        expected = "" if probed.expected_hz is None else f" of {probed.expected_hz:g}"
        yield "rate not told" if probed.rate_hz is None else f"{probed.rate_hz:.4g}{expected} Hz"
        for what, times in (("round trip", probed.round_trip), ("age", probed.age)):
            if times is not None:
                yield f"{what} p50 {times.p50_ms:.3g} ms, p99 {times.p99_ms:.3g} ms"
        if probed.filter_lag_s is not None:
            yield f"filter lag {probed.filter_lag_s * 1e3:.2g} ms"
        if probed.invalid:
            yield f"{probed.invalid} readings not valid"
        if probed.warning:
            yield probed.warning
    yield f"link {probed.link}"
    yield ", ".join(f"{count} {name}" for name, count in probed.counters.items()) or "nothing counted"


def _raise_worst(results: list[Probed]) -> None:
    """Raises InputError with all refusals (exit 2: settings), else RunError with all failures, if any."""
    for verdict, kind in (("refused", InputError), ("failed", RunError)):
        bad = [result for result in results if result.verdict == verdict]
        if bad:
            more = "".join(f"; {result.axis} {result.slot}: {result.error}" for result in bad[1:])
            raise kind(f"{bad[0].axis} {bad[0].slot}: {bad[0].error}{more}")
