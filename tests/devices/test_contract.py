"""Every driver with hardware keeps its port, on its emulated device in stepped time."""

import tomllib
from collections.abc import Callable
from contextlib import ExitStack
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from forefeel.common.hardware.driver import InstalledDriver
from forefeel.common.hardware.link import DeviceLink
from forefeel.devices.bota.driver import BotaSerialLoadCell
from forefeel.devices.coil.driver import CoilHandle
from forefeel.devices.zaber.driver import ZaberStage
from forefeel.testing import (
    DriverContract,
    EmulatedBench,
    HandleContract,
    LoadCellContract,
    StageContract,
    stepped,
)
from tests.repository.pages import DOCS


class TestZaber(StageContract):
    driver = "zaber_ascii"


class TestCia402(StageContract):
    driver = "cia402"


class TestBota(LoadCellContract):
    driver = "bota_serial"


class TestAsciiLine(LoadCellContract):
    driver = "ascii_line"
    distrusted = ("overrange",)  # the resolution of an emulated Loadstar cell hides its noise


class TestCia404(LoadCellContract):
    driver = "cia404"


class TestCoil(HandleContract):
    driver = "coil_serial"


class TestExamplePackage(LoadCellContract):
    """docs/examples/load-cell-driver, which is not installed here."""

    driver = "iio"

    folder = DOCS / "examples" / "load-cell-driver"

    @pytest.fixture(autouse=True)
    def _importable(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.syspath_prepend(self.folder)

    def installed(self) -> InstalledDriver:
        project = tomllib.loads((self.folder / "pyproject.toml").read_text())["project"]
        module, _, name = project["entry-points"]["forefeel.load_cells"][self.driver].partition(":")
        driver = getattr(import_module(module), name)
        return InstalledDriver("load_cell", self.driver, project["name"], project["version"], driver)


# --- drivers that do not ---

Method = Callable[..., Any]


def turned(read: Method) -> Method:
    return lambda *call: [each._replace(force_n=-each.force_n) for each in read(*call)]


def doubled(read: Method) -> Method:
    return lambda *call: [*read(*call)] * 2


def halved(read: Method) -> Method:
    return lambda *call: read(*call)[::2]


def believing(read: Method) -> Method:
    return lambda *call: [each._replace(valid=True) for each in read(*call)]


def unmoved(_: Method) -> Method:
    return lambda *call: call[1]


def creeping(read: Method) -> Method:
    return lambda stage, now_ns: read(stage, now_ns)._replace(position_m=now_ns * 1e-12)


def stronger(render: Method) -> Method:
    return lambda *call: 2.0 * render(*call)


def healing(_: Method) -> Method:
    return lambda link, reason: link.begin()


@pytest.mark.parametrize(
    ("contract", "owner", "method", "change", "check"),
    [
        (TestBota, BotaSerialLoadCell, "read", turned, "test_load_is_read_with_sign_and_value"),
        (TestBota, BotaSerialLoadCell, "read", doubled, "test_reading_comes_once_at_its_rate"),
        (TestBota, BotaSerialLoadCell, "read", halved, "test_reading_comes_once_at_its_rate"),
        (TestBota, BotaSerialLoadCell, "read", believing, "test_fault_of_the_cell_is_not_believed"),
        (TestZaber, ZaberStage, "command", unmoved, "test_stage_follows_and_comes_to_rest"),
        (TestZaber, ZaberStage, "read", creeping, "test_stage_follows_and_comes_to_rest"),
        (TestZaber, DeviceLink, "fault", healing, "test_silent_device_is_a_fault_until_rearmed"),
        (TestCoil, CoilHandle, "render", stronger, "test_rendered_force_is_that_which_was_asked"),
    ],
)  # fmt: skip
def test_driver_that_breaks_its_port_fails(
    contract: type[DriverContract], owner: type, method: str, change: Callable[[Method], Method], check: str,
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path,
) -> None:  # fmt: skip
    monkeypatch.setattr(owner, method, change(getattr(owner, method)))
    tested = contract()
    with stepped() as time, ExitStack() as leave, pytest.raises(AssertionError):
        getattr(tested, check)(EmulatedBench(tested.installed(), tmp_path, time, leave))
