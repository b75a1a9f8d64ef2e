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


def test_columns_have_the_type_of_their_field_and_none_is_nan(path: Path) -> None:
    samples = [force(i, clock_offset_ns=None if i == 5000 else i, valid=i != 1) for i in range(5001)]
    samples[0] = samples[0].model_copy(update={"stamp_ns": 2**62 + 1})
    write_forces(path, samples)
    run = Run(path)
    stamp_ns, offset_ns = run.column(AXIS, FORCE, "stamp_ns"), run.column(AXIS, FORCE, "clock_offset_ns")
    assert (stamp_ns.dtype.name, stamp_ns[0]) == ("int64", 2**62 + 1)
    assert (offset_ns.dtype.name, offset_ns[4999]) == ("float64", 4999.0)
    assert math.isnan(offset_ns[5000])
    np.testing.assert_array_equal(run.column(AXIS, FORCE, "force_n"), np.arange(5001) / 3)
    assert np.flatnonzero(~run.column(AXIS, FORCE, "valid")).tolist() == [1]
    assert len(run.column(AXIS, COMMAND, "position_m")) == 0


def test_the_file_says_what_the_mcap_specification_asks_for(path: Path) -> None:
    """Read with the library's own reader: keys, encodings, schema, stamps and sequence."""
    late = force(2, sequence=2**32 + 5, stamp_ns=-3)
    write_forces(path, [force(1), late])
    with path.open("rb") as file:
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


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.mcap"


def test_messages_and_metadata_come_back_as_they_were_but_for_what_is_no_message(path: Path) -> None:
    forces = [force(i, clock_offset_ns=None if i % 2 else i) for i in range(9000)]
    commands = [command(i) for i in range(50)]
    event = SafetyEvent(
        **header(1), before=SafetyState.READY, event="arm", after=SafetyState.ENGAGING, reason="µ"
    )
    good = encode(force(0))
    wrong = [b"", b"\xc1", good[:-1], good + b"\x00", b"\x93\x01\x02\x03", encode(command(0))]
    with RunWriter(path) as writer:
        writer.add_metadata("versions", {"forefeel": "0.1.0", "größe": "µm"})
        for sample in forces:
            put(writer, sample)
        for payload in wrong:
            writer.write(FORCE.key(CELL, AXIS), payload, START_NS)
        for setpoint in commands:
            put(writer, setpoint, COMMAND, axis="rotation")
        put(writer, event, SAFETY_EVENT)
    run = Run(path)
    assert (run.cell, run.axes, run.truncated) == (CELL, (AXIS, "rotation"), False)
    assert writer.malformed == len(wrong)
    assert run.metadata == {"versions": {"forefeel": "0.1.0", "größe": "µm"}}
    assert list(run.messages(AXIS, FORCE)) == forces
    assert list(run.messages("rotation", COMMAND)) == commands
    assert list(run.messages(AXIS, SAFETY_EVENT)) == [event]
    assert list(run.messages(AXIS, SLAVE_STATE)) == []
    assert run.count(AXIS, FORCE) == 9000
    assert run.log_ns(AXIS, FORCE).tolist() == [sample.stamp_ns + 2 * STEP_NS for sample in forces]


def written_elsewhere(
    path: Path,
    payloads: list[tuple[str, bytes]],
    compression: CompressionType = CompressionType.NONE,
    chunked: bool = True,
) -> Run:
    """A run of another program's writer, which makes a channel for each payload."""
    with path.open("wb") as file:
        writer = Writer(file, compression=compression, use_chunking=chunked)
        writer.start()
        for key, data in payloads:
            writer.add_message(writer.register_channel(key, "json", 0), 1, data, 1)
        writer.finish()  # type: ignore[no-untyped-call]
    return Run(path)


@pytest.mark.parametrize("compression", CompressionType)
@pytest.mark.parametrize("chunked", [True, False])
def test_run_of_another_program_is_read(path: Path, compression: CompressionType, chunked: bool) -> None:
    """Compressed chunks, or none, foreign channels, a channel twice, and a force of protocol 5."""
    older, key = force(1, protocol=5), FORCE.key(CELL, AXIS)
    without = older.model_dump_json(exclude={"setpoint_m", "force_limited"})
    payloads = [(key, force(0).model_dump_json().encode()), ("camera", b"\x00"), (key, without.encode())]
    run = written_elsewhere(path, payloads, compression, chunked)
    assert list(run.messages(AXIS, FORCE)) == [force(0), older]
    assert np.isnan(run.column(AXIS, FORCE, "setpoint_m")).all()
    assert run.axes == (AXIS,)


def test_a_message_that_is_not_of_its_topic_is_named(path: Path) -> None:
    good = force(0).model_dump_json().encode()
    for bad, reason in (
        (good.replace(b'"force_n":0.0', b'"force_n":"x"'), "ForceSample.force_n: "),
        (good.replace(b'"force_n":0.0,', b""), "ForceSample.force_n: "),
        (good[:-1], "ForceSample: Invalid JSON"),
        (good + b"," + good, "ForceSample: Invalid JSON"),
    ):
        run = written_elsewhere(path, [(FORCE.key(CELL, AXIS), data) for data in [*[good] * 5000, bad]])
        with pytest.raises(RecordingError) as caught:
            run.column(AXIS, FORCE, "force_n")
        where = f"{path}: axis {AXIS}, slave/force, message 5000: "
        assert str(caught.value).startswith(where + reason)


def test_axis_and_mapping_are_asked_for_and_two_cells_are_no_run(path: Path) -> None:
    with RunWriter(path) as writer:
        for index, axis in enumerate(["rotation", AXIS] * 2):
            put(writer, force(index), axis=axis)
    with pytest.raises(RecordingError, match=f"holds {AXIS}, rotation"):
        load_recording(path)
    assert load_recording(path, axis="rotation").position_m.tolist() == [0.0, 2e-3]
    with pytest.raises(RecordingError, match="names its columns"):
        load_recording(path, Mapping(time="s:t"))
    path.unlink()
    with RunWriter(path) as writer:
        for cell in ("a", "b"):
            writer.write(FORCE.key(cell, AXIS), encode(force(0)), START_NS)
    with pytest.raises(RecordingError, match="cells 'a' and 'b'"):
        Run(path)


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


def test_an_axis_without_a_valid_force_is_refused_also_beside_one_that_moves(path: Path) -> None:
    with RunWriter(path) as writer:
        for i in range(4):
            put(writer, force(i))
            put(writer, force(i, valid=False), axis="rotation")
    with pytest.raises(RecordingError, match=r"0 sample\(s\)"):
        load_recording(path, axis="rotation")
    assert [column.name for column in load_recording(path, axis=AXIS).further] == ["rotation"]


def test_a_cut_file_is_told(tmp_path: Path) -> None:
    write_forces(tmp_path / "run.mcap", [force(i) for i in range(4)])
    people.mcap(tmp_path / "ros2.mcap")
    for name in ("run.mcap", "ros2.mcap"):
        path = tmp_path / name
        assert CUT not in load_recording(path).notes
        path.write_bytes(path.read_bytes()[:-20])
        assert CUT in load_recording(path).notes


def test_an_impairment_trace_is_put_together_or_refused(path: Path) -> None:
    parts = [("inbound", 2, ((5, 6),)), ("inbound", 0, ((3,), ())), ("outbound", 0, ((9,),))]
    traces = [
        ImpairmentTrace(**header(first), link=link, first_index=first, delays_ns=delays_ns)
        for link, first, delays_ns in parts
    ]
    with RunWriter(path) as writer:
        for trace in traces:
            put(writer, trace, MASTER_IMPAIRMENT)
    run = Run(path)
    assert run.impairment_trace("master/impairment", "inbound") == ((3,), (), (5, 6))
    assert run.impairment_trace("master/impairment", "outbound") == ((9,),)
    assert run.impairment_trace("slave/impairment", "inbound") == ()
    path.unlink()
    with RunWriter(path) as writer:
        put(writer, traces[0], MASTER_IMPAIRMENT)
    with pytest.raises(RecordingError, match="master/impairment of inbound: index 2 follows -1"):
        Run(path).impairment_trace("master/impairment", "inbound")


def test_a_measurement_is_never_overwritten(path: Path) -> None:
    path.write_bytes(b"precious")
    for target, reason in ((path, "File exists"), (path.parent / "none" / "run.mcap", "No such file")):
        with pytest.raises(RecordingError, match=f"{target}: {reason}"):
            RunWriter(target)
    assert path.read_bytes() == b"precious"


def test_a_full_disk_fails_the_run_with_one_line(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    writer = RunWriter(path)
    put(writer, force(0))
    monkeypatch.setattr(os, "fsync", refusing(OSError(28, os.strerror(28))))
    for act in (writer.flush, writer.close):
        with pytest.raises(RunError, match=f"{path}: No space left on device"):
            act()
    writer.close()
