import subprocess
import sys
from pathlib import Path

from forefeel.common.kernels.build import LIBRARY, is_current

ROOT = Path(__file__).parents[2]


def test_three_links_lead_from_the_package_to_top_level_folders() -> None:
    links = {path.name: str(path.readlink()) for path in (ROOT / "src").rglob("*") if path.is_symlink()}
    assert links == {name: f"../../{name}" for name in ("common", "master", "slave")}


def test_make_and_an_editable_installation_leave_the_library_of_these_sources() -> None:
    assert is_current(LIBRARY)


def test_only_the_driver_that_is_named_is_imported() -> None:
    code = (
        "import sys; from forefeel.slave import daemon; from forefeel.slave.settings import SlaveSettings;"
        "from forefeel.common.clock import MonotonicClock;"
        "axis = SlaveSettings().axes[0];"
        "daemon._devices(axis, daemon.SimulatedWorld(axis.simulation, 0), MonotonicClock());"
        "print(sorted({'serial', 'can', 'canopen'} & set(sys.modules)),"
        "[name for name in sys.modules if name.startswith('forefeel.devices.') and 'simulated' not in name])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    serial_modules, devices = done.stdout.split("] [")
    assert serial_modules == "["
    assert "zaber" not in devices
    assert "cia40" not in devices
