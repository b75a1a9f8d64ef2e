"""`forefeel device probe`: every device of a daemon's file, a line each."""

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

from rich.text import Text

from forefeel.common.clock import MonotonicClock, SleepingClock
from forefeel.common.errors import ConfigurationError, InputError, RunError
from forefeel.daemon_settings import load_daemon
from forefeel.devices.shared.stream import latency_warning
from forefeel.interrupt import breakable, heeded
from forefeel.probe.configured import configured
from forefeel.probe.probe import Probed, Quantiles, probe
from forefeel.terminal import answer, show

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
