"""The layouts for other viewers: what they draw stands in a recording, with a field that can be drawn."""

import json
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from mcap.reader import make_reader

from forefeel.common.topics import parse_key
from forefeel.loopback.plan import LoopbackOptions, make_plan
from tests.looped import looped

DEPLOY = Path(__file__).parents[2] / "deploy"
FOXGLOVE: dict[str, Any] = json.loads((DEPLOY / "foxglove" / "forefeel.json").read_text())
PLOTJUGGLER = ElementTree.parse(DEPLOY / "plotjuggler" / "forefeel.xml").getroot()
_PATH = re.compile(r"(\w+(?:/\w+)*)\.(\w+)", re.ASCII)
"""What Foxglove's grammar of message paths takes without quotes."""
Values = dict[str, dict[str, list[Any]]]


def foxglove_paths(kind: str) -> list[tuple[str, str]]:
    """(topic, field) of each series in the panels of one kind."""
    panels = [panel for name, panel in FOXGLOVE["configById"].items() if name.startswith(f"{kind}!")]
    found = [_PATH.fullmatch(path["value"]) for panel in panels for path in panel["paths"]]
    return [(each[1], each[2]) for each in found if each]


def plotjuggler_paths() -> list[tuple[str, str]]:
    """(topic, field) of each curve, whose name is `topic/field`."""
    parts = [curve.attrib["name"].rpartition("/") for curve in PLOTJUGGLER.iter("curve")]
    return [(topic, field) for topic, _, field in parts]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Values:
    """Every value of a run: topic -> field -> values that are not null."""
    folder = tmp_path_factory.mktemp("run")
    plan = make_plan(LoopbackOptions(seed=1, impairment="lan", duration_s=3.0))
    looped(plan).write(folder / "recording.mcap")
    values: Values = {}
    with (folder / "recording.mcap").open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages():
            fields = values.setdefault(channel.topic, {})
            for name, value in json.loads(message.data).items():
                if value is not None:
                    fields.setdefault(name, []).append(value)
    return values


def amiss(topic: str, field: str, recorded: Values, kinds: tuple[type, ...]) -> str | None:
    """What is wrong with a series."""
    parsed = parse_key(topic)
    if parsed is None or topic not in recorded:
        return "no such topic"
    if field not in parsed[2].message.model_fields:
        return "no such field"
    values = recorded[topic].get(field, [])
    return None if values and all(isinstance(value, kinds) for value in values) else "nothing to draw"


def test_plots_draw_numbers_that_a_recording_has(recorded: Values) -> None:
    paths = [*foxglove_paths("Plot"), *plotjuggler_paths()]
    assert len(paths) > 20
    wrong = {path: amiss(*path, recorded, (int, float, bool)) for path in paths}
    assert {path: why for path, why in wrong.items() if why} == {}


def test_states_are_words_that_a_recording_has(recorded: Values) -> None:
    paths = foxglove_paths("StateTransitions")
    assert len(paths) > 2
    wrong = {path: amiss(*path, recorded, (str, bool)) for path in paths}
    assert {path: why for path, why in wrong.items() if why} == {}
