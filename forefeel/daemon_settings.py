"""The settings of either daemon from its YAML file."""

from pathlib import Path

from common.config import load_settings, load_yaml
from common.errors import ConfigurationError
from common.settings import DaemonSettings


def load_daemon(path: Path, role: str | None = None) -> DaemonSettings:
    """The settings of a slave's or master's YAML file, told apart by its `role`.

    Raises:
        ConfigurationError: one line on the first mistake.
    """
    from master.settings import MasterSettings  # noqa: PLC0415 - each daemon loads only its own side
    from slave.settings import SlaveSettings  # noqa: PLC0415

    kinds: dict[str, type[DaemonSettings]] = {"slave": SlaveSettings, "master": MasterSettings}
    data, lines = load_yaml(path)
    found = data.get("role")
    if not isinstance(found, str) or found not in kinds or (role is not None and found != role):
        line = f":{lines[('role',)]}" if ("role",) in lines else ""
        expected = repr(role) if role else "'slave' or 'master'"
        raise ConfigurationError(f"{path}{line}: role = {found!r}: expected {expected}")
    return load_settings(kinds[found], path)
