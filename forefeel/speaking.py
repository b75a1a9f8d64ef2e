"""What a daemon says to the person at its terminal, or to the journal."""

from collections.abc import Mapping
from contextlib import suppress

from forefeel.common.notices import Notices, RateLimit
from forefeel.common.settings import DaemonSettings
from forefeel.devices.shared.stream import latency_warning
from forefeel.probe.configured import configured
from forefeel.terminal import say


class Speaker:
    """Says what the axes of a daemon have to tell; a terminal that is gone stops nothing."""

    def __init__(self, role: str, notices: Mapping[str, Notices]) -> None:
        self._role = role
        self._notices = notices
        self._limit = RateLimit()

    def speak(self, now_ns: int) -> None:
        """What came since the last call; about ten times a second."""
        for name, notices in self._notices.items():
            for text in self._limit.passed(notices.drain(), now_ns):
                with suppress(OSError):
                    say(f"{self._role}: axis {name}: {text}")


def warn_of_latency(role: str, settings: DaemonSettings) -> None:
    """A line for each serial adapter that delays every answer."""
    ports = dict.fromkeys(device.serial_port for device in configured(settings) if device.serial_port)
    for warning in filter(None, map(latency_warning, ports)):
        say(f"{role}: {warning}")


def endpoints(settings: DaemonSettings) -> str:
    """Where it listens and connects, in words."""
    transport = settings.transport
    parts = [f"listening on {', '.join(transport.listen)}"] if transport.listen else []
    parts += [f"connecting to {', '.join(transport.connect)}"] if transport.connect else []
    if transport.pki is not None:
        parts[-1:] = [f"{parts[-1]} with the certificates in {transport.pki}"] if parts else []
    return " and ".join(parts) or "no endpoint configured"
