"""Drivers are found by entry points; what is wrong with one is said in one line."""

from collections.abc import Iterator
from importlib.metadata import EntryPoint, EntryPoints
from typing import Any

import pytest

from forefeel.common.config import checked
from forefeel.common.errors import ConfigurationError
from forefeel.common.hardware import driver
from forefeel.common.hardware.driver import Driver, installed_driver
from forefeel.devices.simulated.settings import SimulatedStageSettings
from forefeel.slave.settings import SlaveSettings

OTHER_NAME = Driver(SimulatedStageSettings, "nowhere:Nothing", "a stage")


@pytest.fixture
def only(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    def only(value: str) -> None:
        found = EntryPoints([EntryPoint("mine", value, "forefeel.stages")])
        monkeypatch.setattr(driver, "_installed", lambda: found)

    installed_driver.cache_clear()
    yield only
    installed_driver.cache_clear()


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("not_installed_anywhere:DRIVER", "No module named 'not_installed_anywhere'"),
        ("forefeel.devices.zaber:NOTHING", "has no attribute 'NOTHING'"),
        ("forefeel.devices.zaber:ZaberSettings", "expected a Driver, not <class"),
        (f"{__name__}:OTHER_NAME", "its settings have no `driver: Literal['mine']`"),
    ],
)
def test_an_entry_point_that_is_no_driver_is_named(only: Any, value: str, message: str) -> None:  # noqa: ANN401
    only(value)
    with pytest.raises(ConfigurationError) as caught:
        installed_driver("stage", "mine")
    assert str(caught.value).startswith(f"driver 'mine' ({value}): ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("section", "message"),
    [
        ("3", "expected a mapping such as {driver: simulated}"),
        ({}, "axes[0].stage.driver: missing, a value is required"),
        ({"driver": "recorded_not", "port": 1}, "expected one of 'cia402', 'simulated', 'zaber_ascii'"),
        ({"driver": "simulated", "port": "/dev/x"}, "unknown key, expected one of driver"),
    ],
)
def test_what_is_wrong_in_a_section_is_said_by_the_settings_of_its_driver(section: Any, message: str) -> None:  # noqa: ANN401
    with pytest.raises(ConfigurationError) as caught:
        checked(SlaveSettings, {"axes": [{"stage": section}]}, "slave.yaml")
    assert message in str(caught.value)
