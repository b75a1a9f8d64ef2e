import subprocess
import sys
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
OURS = ("forefeel", "common", "master", "slave", "devices", "diagnosis")


def foreign(installed: dict[str, list[str]]) -> list[str]:
    """Installed distributions that ship one of our top-level names."""
    others = {name: set(installed.get(name, ())) - {"forefeel"} for name in OURS}
    return sorted(f"{owner} ships {name}" for name, owners in others.items() for owner in owners)


def test_no_installed_distribution_ships_one_of_our_names() -> None:
    installed = {name: list(owners) for name, owners in packages_distributions().items()}
    assert "pytest" in installed, "the list of what is installed can be read"
    assert foreign(installed) == []


@pytest.mark.parametrize("name", OURS)
def test_one_that_did_would_be_found(name: str) -> None:
    assert foreign({name: ["forefeel", "other-robot"]}) == [f"other-robot ships {name}"]


def test_three_links_lead_from_the_package_to_top_level_folders() -> None:
    links = {path.name: str(path.readlink()) for path in (ROOT / "forefeel").rglob("*") if path.is_symlink()}
    assert links == {name: f"../{name}" for name in ("common", "master", "slave")}


def test_only_the_driver_that_is_named_is_imported() -> None:
    code = (
        "import sys; from forefeel.slave import daemon; from forefeel.slave.settings import SlaveSettings;"
        "from forefeel.common.clock import MonotonicClock;"
        "daemon._devices(SlaveSettings().axes[0], MonotonicClock());"
        "print(sorted({'serial', 'can', 'canopen'} & set(sys.modules)),"
        "[name for name in sys.modules if name.startswith('forefeel.devices.') and 'simulated' not in name])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    serial_modules, devices = done.stdout.split("] [")
    assert serial_modules == "["
    assert "zaber" not in devices
    assert "cia40" not in devices
