"""The state folder of a daemon from its start to its end."""

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from forefeel.calibrate.embedded import calibrations
from forefeel.common.clock import Clock
from forefeel.common.config import dump_yaml
from forefeel.common.errors import ForefeelError
from forefeel.common.settings import DaemonSettings
from forefeel.common.state.event_log import StateEventSink
from forefeel.common.state.folder import StateFolder, state_path
from forefeel.probe.configured import configured

_BOOT = Path("/proc/sys/kernel/random/boot_id")


class DaemonState:
    """Folder and event sink of a running daemon."""

    def __init__(self, folder: StateFolder, event_sink: StateEventSink) -> None:
        self.path = folder.path
        self.event_sink = event_sink
        self._folder = folder
        self._open = True

    def close(self, reason: str) -> None:
        """Logs the end of the daemon; idempotent."""
        if self._open:
            self._open = False
            self.event_sink.close(reason)
            self._folder.close()


@contextmanager
def daemon_state(settings: DaemonSettings, role: str, clock: Clock) -> Iterator[DaemonState]:
    """The state of a daemon with these settings from its start to its end.

    Raises:
        ConfigurationError: the folder is in use, or can not be used.
    """
    folder = StateFolder(state_path(settings, role, os.environ))
    try:
        facts = _facts(settings, role)
        axes = [axis["name"] for axis in settings.model_dump(include={"axes"}).get("axes", ())]
        state = DaemonState(folder, StateEventSink(folder, clock, axes, settings.state.flight_records))
    except BaseException:
        folder.close()
        raise
    state.event_sink.start(facts)
    try:
        yield state
    except ForefeelError as error:
        state.close(str(error)[:500])
        raise
    except BaseException as error:
        state.close(f"{type(error).__name__}: {error}"[:500])
        raise
    finally:
        state.close("ended")


def _facts(settings: DaemonSettings, role: str) -> dict[str, str]:
    try:
        software = f"forefeel {version('forefeel')}"
    except PackageNotFoundError:  # run from a source tree
        software = "forefeel, not installed"
    devices = {
        name: " ".join(f"{key}={value}" for key, value in table.items())
        for name, table in calibrations(settings).items()
    }
    return {
        "role": role,
        "cell": settings.cell,
        "software": software,
        "drivers": "; ".join(f"{each.name} {each.driver.origin}" for each in configured(settings)),
        "settings": hashlib.sha256(dump_yaml(settings).encode()).hexdigest()[:16],
        "listen": " ".join(settings.transport.listen),
        "connect": " ".join(settings.transport.connect),
        "process": str(os.getpid()),
        "boot": _BOOT.read_text(encoding="ascii").strip() if _BOOT.exists() else "",
        **devices,
    }
