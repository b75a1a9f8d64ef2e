"""The settings of a daemon, or of whoever has a YAML file of ours."""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, cast

from forefeel.common.config import Settings, checked
from forefeel.common.errors import ConfigurationError
from forefeel.common.yaml_file import load_yaml

if TYPE_CHECKING:
    from forefeel.master.settings import MasterSettings
    from forefeel.slave.settings import SlaveSettings

_KINDS = {
    "slave": ("forefeel.slave.settings", "SlaveSettings"),
    "master": ("forefeel.master.settings", "MasterSettings"),
    "recorder": ("forefeel.network_settings", "ObserverSettings"),
    "viewer": ("forefeel.network_settings", "ObserverSettings"),
    "router": ("forefeel.network_settings", "RouterSettings"),
}
"""By role, imported when it is asked for: each daemon loads only its own side."""


def load_daemon(path: Path, *roles: str) -> "SlaveSettings | MasterSettings":
    """The settings of a slave's or master's YAML file; see `load_any`."""
    return cast("SlaveSettings | MasterSettings", load_any(path, *(roles or ("slave", "master"))))


def load_any(path: Path, *roles: str) -> Settings:
    """Loads a YAML file as the validated settings of its `role`, whose module alone is imported. `roles`:
    those that are accepted, or all of `_KINDS`. Relative paths in it count from its folder.

    Raises:
        ConfigurationError: no such file, another role, or the first wrong value, in one line.
    """
    data, lines = load_yaml(path)
    role, expected = data.get("role"), [repr(name) for name in roles or _KINDS]
    if repr(role) not in expected:
        line = f":{lines['role',]}" if ("role",) in lines else ""
        raise ConfigurationError(f"{path}{line}: role = {role!r}: expected {' or '.join(expected)}")
    module, name = _KINDS[str(role)]
    kind: type[Settings] = getattr(import_module(module), name)
    return checked(kind, data, str(path), lines, path.parent)
