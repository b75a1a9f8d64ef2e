"""The reference names every setting, topic, message and command, with its unit and range."""

import re
from collections.abc import Iterator
from importlib import import_module
from pkgutil import walk_packages

import pytest
from pydantic import BaseModel

import forefeel
from docs.hooks import causes, command_line, configuration, markdown, messages
from forefeel.common import messages as m
from forefeel.common.causes.base import Effect
from forefeel.common.causes.registry import OWN
from forefeel.common.config import Settings
from forefeel.common.topics import BY_NAME
from tests.commands.command_line import COMMANDS
from tests.repository.commands import tree

_MODULES = ("settings", "hardware.calibration", "report.vessel")
_BASES = {  # never a section: what derives from them is
    "DaemonSettings", "SerialSettings", "DriverSettings", "StageDriverSettings", "GripperDriverSettings",
    "LoadCellDriverSettings", "HandleDriverSettings", "ScaledStageSettings", "CellSettings",
    "SerialCellSettings", "AxisSettings", "WorldDriverSettings",
}  # fmt: skip
WITHOUT_UNIT = {
    "connections", "seed", "loss", "burst_loss", "burst_length", "reorder", "duplicate", "priority",
    "flight_records", "device", "axis", "sign", "node_id", "port", "method", "force_scale", "force_axis",
    "friction", "direction",
}  # fmt: skip


def subclasses(kind: type[BaseModel]) -> Iterator[type[BaseModel]]:
    for each in kind.__subclasses__():
        yield each
        yield from subclasses(each)


def every_settings() -> list[type[BaseModel]]:
    """Not by way of the hook: every class of settings in any module that has some."""
    for module in walk_packages(forefeel.__path__, "forefeel."):
        if module.name.endswith(_MODULES):
            import_module(module.name)
    found = [each for each in subclasses(Settings) if each.__module__.startswith("forefeel.")]
    return [each for each in dict.fromkeys(found) if each.__name__ not in _BASES]


def rows(page: str, anchor: str) -> dict[str, list[str]]:
    """The rows of the section with that anchor, by their first cell."""
    parts = re.split(r"^#+ .*\{ #([\w-]+) \}$", page, flags=re.MULTILINE)
    sections = dict(zip(parts[1::2], parts[2::2], strict=True))
    lines = [line for line in sections[anchor].splitlines() if line.startswith("| `")]
    cells = [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines]
    return {first.strip("`"): rest for first, *rest in cells}


CONFIGURATION = configuration.page()
COMMAND_LINE = command_line.page()
SETTINGS = every_settings()


def test_there_are_settings_to_look_for() -> None:
    assert {"GateSettings", "RenderingSettings", "Cia402Settings", "RouterSettings"} <= {
        kind.__name__ for kind in SETTINGS
    }


@pytest.mark.parametrize("kind", SETTINGS, ids=lambda kind: kind.__name__)
def test_every_setting_is_named(kind: type[BaseModel]) -> None:
    assert list(rows(CONFIGURATION, kind.__name__)) == list(kind.model_fields)


def test_units_ranges_and_defaults_are_those_of_the_models() -> None:
    gate = rows(CONFIGURATION, "GateSettings")
    assert gate["watchdog_s"] == ["s", "number, 0 to 0.3", "`0.06`"]
    assert gate["alignment_m"] == ["m", "number, above 0 to 0.05", "`0.001`"]
    assert gate["force_timeout_s"] == ["s", "number, above 0 to 5 or `null`", "`0.2`"]
    assert gate["stop_deceleration_m_s2"][0] == "m/s²"
    stage = rows(CONFIGURATION, "Cia402Settings")
    assert stage["counts_per_m"] == ["counts/m", "number, above 0", "required"]
    assert stage["sign"] == ["", "`1`, `-1`", "`1`"]
    assert stage["can"][1] == "[CanSettings](#CanSettings)"
    assert "[zaber_ascii](#ZaberSettings)" in rows(CONFIGURATION, "SlaveAxisSettings")["stage"][1]


def test_a_number_has_a_unit_or_is_known_to_have_none() -> None:
    for kind in SETTINGS:
        for name, (unit, shown, _) in rows(CONFIGURATION, kind.__name__).items():
            if shown.startswith(("number", "integer", "[number")) and name not in WITHOUT_UNIT:
                assert unit, f"{kind.__name__}.{name}: no unit"


def test_every_topic_and_message_is_named() -> None:
    page = messages.page()
    head = page.split("## Service")[0]
    for name, topic in BY_NAME.items():
        assert f"| `{name}` | [{topic.message.__name__}](#{topic.message.__name__}) |" in head
    for kind in subclasses(m.Message):
        if kind.__module__ == m.__name__:
            own = [name for name in kind.model_fields if name not in m.Message.model_fields]
            assert list(rows(page, kind.__name__)) == own
    assert list(rows(page, "Message")) == list(m.Message.model_fields)
    for state in m.SafetyState:
        assert f"`{state.value}`" in page.split("{ #SafetyState }")[1]


@pytest.mark.parametrize("kind", OWN.values(), ids=lambda kind: kind.name)
def test_every_cause_is_named_with_its_parameters(kind: type[Effect]) -> None:
    shown = rows(causes.page(), kind.name)
    assert {name: values[0] for name, values in shown.items()} == {
        each.name: each.unit for each in kind.parameters
    }


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_every_command_is_named_with_its_options(command: list[str]) -> None:
    section = COMMAND_LINE.split(f"## forefeel {' '.join(command)} {{ #")[1].split("\n## ")[0]
    found = tree()
    for name in command:
        found = found.commands[name]
    for each in found.params:
        for name in each.opts:
            shown = name if name.startswith("-") else f"| `{(each.metavar or name.upper()).split('|')[0]}"
            assert shown in section or name == "--help", name
    assert found.epilog.split("Example: ")[1].strip() in section


def test_a_cell_can_not_break_its_table() -> None:
    assert markdown.table(["a"], [["x | y\nz"]]).splitlines()[-1] == "| x \\| y z |"
    assert markdown.table(["a"], [["`x|y`"]]).splitlines()[-1] == "| `x|y` |"


def test_code_in_a_numbered_list_stays_in_its_item() -> None:
    written = "1. do:\n   ```\n   a\n     b\n   ```\n   then\n2. see\n\n```\n   as it is\n```\n"
    assert markdown.nested(written) == (
        "1. do:\n\n    ```\n    a\n      b\n    ```\n\n    then\n\n2. see\n\n```\n   as it is\n```\n"
    )
