"""Our runs, read by an independent MCAP reader: @mcap/core under node.

FOREFEEL_NODE_MODULES may name a `node_modules` folder that keeps the reader between test runs.
"""

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from forefeel.common.messages import Message, ModelParameters, SafetyEvent, SafetyState
from forefeel.common.recording.mcap_reader import Run, read_run
from forefeel.common.recording.mcap_writer import RunWriter
from forefeel.common.topics import BY_NAME, COMMAND, FORCE, PARAMETERS, SAFETY_EVENT, Topic
from tests.unit.recording_samples import AXIS, command, force, header, put

READER = "@mcap/core@2.2.2"
SCRIPT = Path(__file__).with_name("read_mcap.mjs")


@pytest.fixture(scope="session")
def node_modules(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if shutil.which("node") is None or shutil.which("npm") is None:
        pytest.skip("node and npm are not installed")
    kept = os.environ.get("FOREFEEL_NODE_MODULES")
    modules = Path(kept) if kept else tmp_path_factory.mktemp("node") / "node_modules"
    if not (modules / "@mcap/core").is_dir():
        install(modules.parent)
    return modules


def install(folder: Path) -> None:
    options = ["--no-save", "--no-audit", "--no-fund", "--ignore-scripts", "--prefix", str(folder)]
    try:
        subprocess.run(
            ["npm", "install", *options, READER], capture_output=True, check=True, timeout=45, text=True
        )
    except subprocess.TimeoutExpired:
        pytest.skip(f"npm did not install {READER} within 45 s")
    except subprocess.CalledProcessError as error:
        pytest.skip(f"npm can not install {READER}: {error.stderr.strip().splitlines()[:1]}")


def read_with_node(node_modules: Path, path: Path) -> dict[str, Any]:
    done = subprocess.run(
        ["node", str(SCRIPT), str(node_modules), str(path)],
        capture_output=True,
        timeout=30,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


def parameters(index: int) -> ModelParameters:
    return ModelParameters(
        **header(index),
        names=("stiffness_n_m", "friction_n"),
        values=(120.5, 0.25),
        standard_deviations=(1.5, 1e-9),
        identifiable=("stiffness_n_m",),
        valid=True,
        samples=index,
        updates=index,
        resets=0,
        innovation_rms_n=0.01,
    )


def write_run(writer: RunWriter) -> None:
    event = SafetyEvent(
        **header(3), before=SafetyState.READY, event="arm", after=SafetyState.ENGAGING, reason="µ"
    )
    writer.add_metadata("versions", {"forefeel": "0.1.0", "unit": "µm"})
    writer.attach("master.yaml", "application/yaml", b"axes: [insertion]\n")
    put(writer, event, SAFETY_EVENT)
    for index in range(3000):
        for axis in (AXIS, "rotation"):
            put(writer, force(index), axis=axis)
        put(writer, command(index), COMMAND)
        if index % 50 == 0:
            put(writer, parameters(index), PARAMETERS)
        if index % 1000 == 999:
            writer.flush()


def expected_channels(run: Run) -> dict[str, dict[str, Any]]:
    """What our reader says, in the form of the script's answer."""
    channels = {}
    for axis in run.axes:
        for topic in BY_NAME.values():
            messages = list(run.messages(axis, topic))
            if messages:
                channels[topic.key("cell", axis)] = expected_channel(topic, messages)
    return channels


def expected_channel(topic: Topic[Message], messages: list[Message]) -> dict[str, Any]:
    return {
        "topic": topic.name,
        "messageEncoding": "json",
        "schema": topic.message.__name__,
        "schemaEncoding": "jsonschema",
        "messages": len(messages),
        "last": messages[-1].model_dump(mode="json"),
    }


def answered_channels(answer: dict[str, Any]) -> dict[str, dict[str, Any]]:
    channels = {channel["topic"]: channel for channel in answer["channels"]}
    for key, channel in channels.items():
        assert {"session_id", "sequence", "stamp_ns"} <= set(channel.pop("required"))
        channel["topic"] = key.split("/", 3)[3]
    return channels


def test_an_independent_reader_finds_the_same_run(tmp_path: Path, node_modules: Path) -> None:
    path = tmp_path / "run.mcap"
    with RunWriter(path) as writer:
        write_run(writer)
    run = read_run(path)
    answer = read_with_node(node_modules, path)
    counts = [run.count(AXIS, topic) for topic in (FORCE, COMMAND, PARAMETERS, SAFETY_EVENT)]
    assert counts == [3000, 3000, 60, 1]
    assert answer["streamed"]["complete"]
    assert answered_channels(answer["streamed"]) == expected_channels(run)
    assert answered_channels(answer["indexed"]) == expected_channels(run)
    assert answer["indexed"]["metadata"] == run.metadata
    assert answer["indexed"]["attachments"] == {"master.yaml": "axes: [insertion]\n"}


def test_both_readers_find_the_same_in_a_file_of_a_killed_writer(tmp_path: Path, node_modules: Path) -> None:
    path = tmp_path / "run.mcap"
    with RunWriter(path) as writer:
        write_run(writer)
    os.truncate(path, path.stat().st_size * 2 // 3)
    run = read_run(path)
    answer = read_with_node(node_modules, path)
    assert run.truncated
    assert not answer["streamed"]["complete"]
    assert answered_channels(answer["streamed"]) == expected_channels(run)
    assert 1000 <= run.count(AXIS, FORCE) < 3000
