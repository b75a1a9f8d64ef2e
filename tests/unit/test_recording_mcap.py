"""A run is written and read back."""

import json
import math
import os
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from forefeel.common.codec import encode
from forefeel.common.errors import RecordingError, RunError
from forefeel.common.messages import ImpairmentTrace, SafetyEvent, SafetyState
from forefeel.common.recording.loading import load_recording
from forefeel.common.recording.mcap_reader import CUT, Run
from forefeel.common.recording.mcap_writer import RunWriter
from forefeel.common.recording.units import Mapping
from forefeel.common.topics import COMMAND, FORCE, MASTER_IMPAIRMENT, SAFETY_EVENT, SLAVE_STATE
from tests.unit import people
from tests.unit.failing import refusing
from tests.unit.recording_samples import (
    AXIS,
    CELL,
    START_NS,
    STEP_NS,
    command,
    force,
    header,
    put,
    write_forces,
)  # fmt: skip


def test_messages_come_back_as_they_were(tmp_path: Path) -> None:
    forces = [force(i, clock_offset_ns=None if i % 2 else i) for i in range(9000)]
    commands = [command(i) for i in range(50)]
    event = SafetyEvent(
        **header(1), before=SafetyState.READY, event="arm", after=SafetyState.ENGAGING, reason="µ"
    )
    with RunWriter(tmp_path / "run.mcap") as writer:
        for sample in forces:
            put(writer, sample)
        for setpoint in commands:
            put(writer, setpoint, COMMAND, axis="rotation")
        put(writer, event, SAFETY_EVENT)
    run = Run(tmp_path / "run.mcap")
    assert (run.cell, run.axes, run.truncated, writer.malformed) == (CELL, (AXIS, "rotation"), False, 0)
    assert list(run.messages(AXIS, FORCE)) == forces
    assert list(run.messages("rotation", COMMAND)) == commands
    assert list(run.messages(AXIS, SAFETY_EVENT)) == [event]
    assert list(run.messages(AXIS, SLAVE_STATE)) == []
    assert run.count(AXIS, FORCE) == 9000
    assert run.log_ns(AXIS, FORCE).tolist() == [sample.stamp_ns + 2 * STEP_NS for sample in forces]


def test_columns_have_the_type_of_their_field_and_none_is_nan(tmp_path: Path) -> None:
    samples = [force(i, clock_offset_ns=None if i == 5000 else i, valid=i != 1) for i in range(5001)]
    samples[0] = samples[0].model_copy(update={"stamp_ns": 2**62 + 1})
    write_forces(tmp_path / "run.mcap", samples)
    run = Run(tmp_path / "run.mcap")
    stamp_ns, offset_ns = run.column(AXIS, FORCE, "stamp_ns"), run.column(AXIS, FORCE, "clock_offset_ns")
    assert (stamp_ns.dtype.name, stamp_ns[0]) == ("int64", 2**62 + 1)
    assert (offset_ns.dtype.name, offset_ns[4999]) == ("float64", 4999.0)
    assert math.isnan(offset_ns[5000])
    np.testing.assert_array_equal(run.column(AXIS, FORCE, "force_n"), np.arange(5001) / 3)
    assert np.flatnonzero(~run.column(AXIS, FORCE, "valid")).tolist() == [1]
    assert run.column(AXIS, FORCE, "force_n") is run.column(AXIS, FORCE, "force_n")
    assert len(run.column(AXIS, COMMAND, "position_m")) == 0


def test_run_metadata_is_read_back(tmp_path: Path) -> None:
    with RunWriter(tmp_path / "run.mcap") as writer:
        writer.add_metadata("versions", {"forefeel": "0.1.0", "größe": "µm"})
        put(writer, force(0))
    run = Run(tmp_path / "run.mcap")
    assert run.metadata == {"versions": {"forefeel": "0.1.0", "größe": "µm"}}
    assert run.count(AXIS, FORCE) == 1


def test_payloads_that_are_no_message_are_counted_and_not_written(tmp_path: Path) -> None:
    good = encode(force(0))
    wrong = [b"", b"\xc1", good[:-1], good + b"\x00", b"\x93\x01\x02\x03", encode(command(0))]
    with RunWriter(tmp_path / "run.mcap") as writer:
        for payload in [good, *wrong, good]:
            writer.write(FORCE.key(CELL, AXIS), payload, START_NS)
    assert writer.malformed == len(wrong)
    assert Run(tmp_path / "run.mcap").count(AXIS, FORCE) == 2


def test_the_file_says_what_the_mcap_specification_asks_for(tmp_path: Path) -> None:
    """Read with the library's own reader: keys, encodings, schema, stamps and sequence."""
    late = force(2, sequence=2**32 + 5, stamp_ns=-3)
    write_forces(tmp_path / "run.mcap", [force(1), late])
    with (tmp_path / "run.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        found = list(reader.iter_messages(log_time_order=False))
        by_index = [m.sequence for _, _, m in reader.iter_messages(starting_at=STEP_NS)]
    assert by_index == [5, 1]
    schema, channel, first = found[0]
    assert schema is not None
    assert (schema.name, schema.encoding) == ("ForceSample", "jsonschema")
    assert set(json.loads(schema.data)["properties"]) == set(type(late).model_fields)
    assert (channel.topic, channel.message_encoding) == (f"forefeel/{CELL}/{AXIS}/slave/force", "json")
    assert channel.metadata == {"cell": CELL, "axis": AXIS}
    assert json.loads(first.data) == force(1).model_dump(mode="json")
    stamps = [(m.log_time, m.publish_time, m.sequence) for _, _, m in found]
    assert stamps == [(START_NS + 3 * STEP_NS, START_NS + STEP_NS, 1), (2 * STEP_NS - 3, 0, 5)]


@pytest.mark.parametrize("compression", CompressionType)
@pytest.mark.parametrize("chunked", [True, False])
def test_a_run_that_another_program_wrote_again_is_read(
    tmp_path: Path, compression: CompressionType, chunked: bool
) -> None:
    """Compressed chunks, or none, foreign channels, a channel twice, and a force of protocol 5."""
    older = force(1, protocol=5)
    payloads = [
        force(0).model_dump_json(), None, older.model_dump_json(exclude={"setpoint_m", "force_limited"})
    ]  # fmt: skip
    with (tmp_path / "run.mcap").open("wb") as file:
        writer = Writer(file, compression=compression, use_chunking=chunked)
        writer.start()
        keys = [FORCE.key(CELL, AXIS), "camera", FORCE.key(CELL, AXIS)]
        for key, payload in zip(keys, payloads, strict=True):
            data = payload.encode() if payload else b"\x00"
            writer.add_message(writer.register_channel(key, "json", 0), 1, data, 1)
        writer.finish()  # type: ignore[no-untyped-call]
    run = Run(tmp_path / "run.mcap")
    assert list(run.messages(AXIS, FORCE)) == [force(0), older]
    assert np.isnan(run.column(AXIS, FORCE, "setpoint_m")).all()
    assert run.axes == (AXIS,)


def test_a_message_that_is_not_of_its_topic_is_named(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    good = force(0).model_dump_json().encode()
    cases = [
        (good.replace(b'"force_n":0.0', b'"force_n":"x"'), "ForceSample.force_n: "),
        (good.replace(b'"force_n":0.0,', b""), "ForceSample.force_n: "),
        (good[:-1], "ForceSample: Invalid JSON"),
        (good + b"," + good, "ForceSample: Invalid JSON"),
    ]
    for bad, reason in cases:
        with path.open("wb") as file:
            writer = Writer(file, compression=CompressionType.NONE)
            writer.start()
            channel = writer.register_channel(FORCE.key(CELL, AXIS), "json", 0)
            for data in [*[good] * 5000, bad]:
                writer.add_message(channel, 1, data, 1)
            writer.finish()  # type: ignore[no-untyped-call]
        with pytest.raises(RecordingError) as caught:
            Run(path).column(AXIS, FORCE, "force_n")
        where = f"{path}: axis {AXIS}, slave/force, message 5000: "
        assert str(caught.value).startswith(where + reason)


def test_a_recording_is_made_of_the_valid_samples_in_the_order_of_their_stamps(tmp_path: Path) -> None:
    order = [2, 0, 1, 1, 3, 5]
    write_forces(tmp_path / "trial.mcap", [force(i, valid=i != 3) for i in order])
    for recording in (
        load_recording(tmp_path / "trial.mcap"),
        load_recording(tmp_path / "trial.mcap", axis=AXIS),
    ):
        assert recording.name == f"trial/{AXIS}"
        assert recording.source == f"{tmp_path / 'trial.mcap'}: axis {AXIS}"
        assert recording.time_s == pytest.approx([0.0, 0.001, 0.002, 0.005], abs=1e-15)
        assert recording.position_m.tolist() == [0.0, 1e-3, 2e-3, 5e-3]
        assert recording.force_n is not None
        assert recording.force_n.tolist() == [0.0, 1 / 3, 2 / 3, 5 / 3]


def test_a_cut_file_is_told(tmp_path: Path) -> None:
    write_forces(tmp_path / "run.mcap", [force(i) for i in range(4)])
    people.mcap(tmp_path / "ros2.mcap")
    for name in ("run.mcap", "ros2.mcap"):
        path = tmp_path / name
        assert CUT not in load_recording(path).notes
        path.write_bytes(path.read_bytes()[:-20])
        assert CUT in load_recording(path).notes


def test_which_axis_and_which_mapping(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with RunWriter(path) as writer:
        for index, axis in enumerate(["rotation", AXIS] * 2):
            put(writer, force(index), axis=axis)
    with pytest.raises(RecordingError, match=f"holds {AXIS}, rotation"):
        load_recording(path)
    assert load_recording(path, axis="rotation").position_m.tolist() == [0.0, 2e-3]
    with pytest.raises(RecordingError, match="names its columns"):
        load_recording(path, Mapping(time="s:t"))


def trace(first_index: int, delays_ns: tuple[tuple[int, ...], ...], link: str = "inbound") -> ImpairmentTrace:
    return ImpairmentTrace(**header(first_index), link=link, first_index=first_index, delays_ns=delays_ns)


def test_an_impairment_trace_is_put_together_or_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    parts = [trace(2, ((5, 6),)), trace(0, ((3,), ())), trace(0, ((9,),), link="outbound")]
    with RunWriter(path) as writer:
        for part in parts:
            put(writer, part, MASTER_IMPAIRMENT)
    run = Run(path)
    assert run.impairment_trace("master/impairment", "inbound") == ((3,), (), (5, 6))
    assert run.impairment_trace("master/impairment", "outbound") == ((9,),)
    assert run.impairment_trace("slave/impairment", "inbound") == ()
    path.unlink()
    with RunWriter(path) as writer:
        put(writer, parts[0], MASTER_IMPAIRMENT)
    with pytest.raises(RecordingError, match="master/impairment of inbound: index 2 follows -1"):
        Run(path).impairment_trace("master/impairment", "inbound")


def test_two_cells_are_no_run(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with RunWriter(path) as writer:
        for cell in ("a", "b"):
            writer.write(FORCE.key(cell, AXIS), encode(force(0)), START_NS)
    with pytest.raises(RecordingError, match="cells 'a' and 'b'"):
        Run(path)


def test_a_measurement_is_never_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(b"precious")
    for target, reason in ((path, "File exists"), (tmp_path / "none" / "run.mcap", "No such file")):
        with pytest.raises(RecordingError, match=f"{target}: {reason}"):
            RunWriter(target)
    assert path.read_bytes() == b"precious"


def test_a_full_disk_fails_the_run_with_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    writer = RunWriter(tmp_path / "run.mcap")
    put(writer, force(0))
    monkeypatch.setattr(os, "fsync", refusing(OSError(28, os.strerror(28))))
    for act in (writer.flush, writer.close):
        with pytest.raises(RunError, match=f"{writer._path}: No space left on device"):
            act()
    writer.close()
