"""Files of writers that were killed, and files that are damaged."""

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from forefeel.common.errors import RecordingError
from forefeel.common.messages import EmergencyStop
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.recording.mcap_writer import RunWriter
from forefeel.common.topics import EMERGENCY_STOP
from tests.unit.recording_samples import AXIS, force, header, put, write_forces


def stops(run: Run) -> list[EmergencyStop]:
    return list(run.messages(AXIS, EMERGENCY_STOP)) if run.axes else []


MESSAGES = [EmergencyStop(**header(i), source="operator", reason=f"{i}") for i in range(7)]


def flushed_run(path: Path) -> dict[int, int]:
    """A small run: how many of its messages stand in the file at a size."""
    flushed = {}
    with RunWriter(path) as writer:
        writer.add_metadata("versions", {"forefeel": "0.1.0"})
        for index, message in enumerate(MESSAGES):
            put(writer, message, EMERGENCY_STOP)
            if index in (1, 2, 5):
                writer.end_chunk()
                flushed[path.stat().st_size] = index + 1
    return flushed


def test_every_prefix_of_a_run_reads_a_prefix_of_its_messages_and_zeros_are_the_end(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    flushed, longest = flushed_run(path), len(MESSAGES)
    for size in range(path.stat().st_size - 1, 7, -1):
        os.truncate(path, size)
        run = Run(path)
        found = stops(run)
        assert run.truncated
        assert found == MESSAGES[: len(found)]
        assert flushed.get(size, 0) <= len(found) <= longest
        longest = len(found)
        if size in flushed:  # what a loss of power leaves
            path.write_bytes(path.read_bytes() + bytes(4096))
            run = Run(path)
            assert run.truncated and stops(run) == found
    assert longest == 0
    for size in range(7, -1, -1):
        os.truncate(path, size)
        with pytest.raises(RecordingError, match=r"run\.mcap: (empty file|does not start as an MCAP file)"):
            Run(path)


@pytest.mark.parametrize("flip", [0x01, 0x80])
def test_no_damaged_byte_changes_a_message_or_raises_anything_else(tmp_path: Path, flip: int) -> None:
    path = tmp_path / "run.mcap"
    flushed_run(path)
    whole = path.read_bytes()
    for place, byte in enumerate(whole):
        path.write_bytes(whole[:place] + bytes([byte ^ flip]) + whole[place + 1 :])
        try:
            run = Run(path)
            found = stops(run)
        except RecordingError as error:
            assert "\n" not in str(error)
        else:
            assert found == MESSAGES[: len(found)]
            assert len(found) == len(MESSAGES) or run.truncated


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(st.binary(max_size=200))
def test_any_bytes_behind_the_magic_are_a_run_or_one_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + content)
    try:
        assert Run(path).axes == ()
    except RecordingError as error:
        assert str(error).startswith(f"{path}: ")
        assert "\n" not in str(error)


def test_a_damaged_chunk_is_named_by_its_place(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    write_forces(path, [force(i) for i in range(3)])
    content = bytearray(path.read_bytes())
    content[content.index(b"\x28\xb5\x2f\xfd") + 100] ^= 1  # in a frame of zstd (RFC 8878, 3.1.1)
    path.write_bytes(content)
    with pytest.raises(RecordingError) as caught:
        Run(path)
    chunk = content.index(b"\x06", 8)
    assert f"damaged at byte {chunk} (" in str(caught.value)
