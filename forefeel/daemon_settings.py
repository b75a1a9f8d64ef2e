"""The settings of a daemon, or of whoever has a YAML file of ours."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from forefeel.common.config import Settings, checked, load_settings
from forefeel.common.errors import ConfigurationError
from forefeel.common.yaml_file import Place, load_yaml

if TYPE_CHECKING:
    from forefeel.master.settings import MasterSettings
    from forefeel.slave.settings import SlaveSettings


def load_daemon(path: Path, role: str | None = None) -> "SlaveSettings | MasterSettings":
    """The settings of a slave's or master's YAML file, told apart by its `role`.

    Raises:
        ConfigurationError: one line on the first mistake.
    """
    data, lines = load_yaml(path)
    if _role(path, data, lines, (role,) if role else ("slave", "master")) == "slave":
        from forefeel.slave.settings import SlaveSettings  # noqa: PLC0415 - each daemon loads only its own side

        return checked(SlaveSettings, data, str(path), lines, path.parent)
    from forefeel.master.settings import MasterSettings  # noqa: PLC0415

    return checked(MasterSettings, data, str(path), lines, path.parent)


def load_any(path: Path) -> Settings:
    """The settings of any of our YAML files, told apart by its `role`.

    Raises:
        ConfigurationError: one line on the first mistake.
    """
    from forefeel.network_settings import ObserverSettings, RouterSettings  # noqa: PLC0415

    others: dict[str, type[Settings]] = {
        "recorder": ObserverSettings,
        "viewer": ObserverSettings,
        "router": RouterSettings,
    }
    role = _role(path, *load_yaml(path), ("slave", "master", *others))
    return load_settings(others[role], path) if role in others else load_daemon(path)


def _role(path: Path, data: dict[str, Any], lines: dict[Place, int], expected: tuple[str, ...]) -> str:
    found = data.get("role")
    if not isinstance(found, str) or found not in expected:
        line = f":{lines[('role',)]}" if ("role",) in lines else ""
        *first, last = (repr(role) for role in expected)
        words = f"{', '.join(first)} or {last}" if first else last
        raise ConfigurationError(f"{path}{line}: role = {found!r}: expected {words}")
    return found
