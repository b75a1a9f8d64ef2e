"""Files that unpack to far more than they hold are refused in one line, before the memory is taken."""

import subprocess
import sys
from pathlib import Path

import lz4.frame
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk
from mcap.writer import MCAP0_MAGIC

from tests.unit.recording_bombs import expanding_files

ROOT = Path(__file__).parents[2]
_UNPACKED = 256 * 2**20
_MOST_USED = 128 * 2**20
"""What reading the files may take: their 1 MiB, 16 MiB and a hundredfold of it at most, and the libraries."""
_READ = """
import resource, sys
from pathlib import Path
import h5py, numpy, openpyxl, pyarrow.parquet, lz4.frame, rosbags.highlevel, scipy.io
resource.setrlimit(resource.RLIMIT_AS, (6 * 2**30, 6 * 2**30))  # the machine survives one that is not refused
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.recording.mcap_spans import RunSpans
from forefeel.common.recording.loading import load_recording
from forefeel.common.errors import InputError
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
for kind, path in zip(sys.argv[1::2], sys.argv[2::2], strict=True):
    try:
        {"run": Run, "spans": RunSpans, "table": load_recording}[kind](Path(path))
    except InputError as error:
        print(error)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""


def mcap(path: Path, compression: str, packed: bytes, claimed: int) -> Path:
    builder = RecordBuilder()
    Chunk(
        compression=compression, data=packed, message_start_time=0, message_end_time=1,
        uncompressed_crc=0, uncompressed_size=claimed,
    ).write(builder)  # fmt: skip
    path.write_bytes(MCAP0_MAGIC + builder.end())  # type: ignore[no-untyped-call]
    return path


def bombs(folder: Path) -> list[tuple[str, Path]]:
    """Each unpacks to 256 MiB; a lying one claims to be small."""
    zeros, found = bytes(_UNPACKED), []
    for compression, packed in (("zstd", zstandard.compress(zeros)), ("lz4", lz4.frame.compress(zeros))):
        for kind, claimed in (("honest", _UNPACKED), ("lying", 1000)):
            path = mcap(folder / f"{kind}-{compression}.mcap", compression, packed, claimed)
            found += [("run", path), ("spans", path)]
    return found


def refused(files: list[tuple[str, Path]]) -> list[str]:
    """The line that is said of each, in a process of its own that must not take much memory for it."""
    words = [sys.executable, "-c", _READ, *(str(word) for each in files for word in each)]
    done = subprocess.run(words, capture_output=True, text=True, cwd=ROOT, check=True)
    *said, kib = done.stdout.splitlines()
    assert int(kib) * 1024 < _MOST_USED
    return said


def test_a_run_of_chunks_that_unpack_to_more_than_they_may(tmp_path: Path) -> None:
    files = bombs(tmp_path)
    for (_, path), said in zip(files, refused(files), strict=True):
        assert path.stat().st_size < 2 * 2**20
        assert said.startswith(f"{path}: damaged at byte "), said
        assert ("allowed" if "honest" in path.name else "by its head") in said


def test_files_that_libraries_expand(tmp_path: Path) -> None:
    files = expanding_files()
    for name, (write, _) in files.items():
        write(tmp_path / name)
    lines = refused([("table", tmp_path / name) for name in files])
    for (name, (_, expected)), line in zip(files.items(), lines, strict=True):
        assert line.startswith(str(tmp_path / name)), line
        assert expected in line
