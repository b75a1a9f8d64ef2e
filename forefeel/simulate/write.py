"""A table of a recording: CSV or Parquet, there whole or not at all."""

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from common.errors import ConfigurationError, RunError
from common.recording.recording import Array

SUFFIXES = (".csv", ".parquet")


def check_target(out: Path, overwrite: bool) -> None:
    """Refuses what can not be written, before anything is computed.

    Raises:
        ConfigurationError: another suffix, a folder, a file that may not go, or Parquet without pyarrow.
    """
    if out.suffix.lower() not in SUFFIXES:
        raise ConfigurationError(f"--out {out}: suffix {out.suffix!r}, expected .csv or .parquet")
    if out.is_dir():
        raise ConfigurationError(f"--out {out}: is a folder, expected a file")
    if out.exists() and not overwrite:
        raise ConfigurationError(f"--out {out}: exists, expected a new file, or --overwrite")
    if out.suffix.lower() == ".parquet":
        try:
            import pyarrow.parquet  # noqa: F401, PLC0415 - optional, and slow to import
        except ImportError as error:
            raise ConfigurationError(
                f"--out {out}: writing Parquet needs pyarrow: pip install forefeel[parquet]"
            ) from error


def write_table(out: Path, columns: Mapping[str, Array]) -> None:
    """Beside the file, then in its place.

    Raises:
        RunError: it can not be written.
    """
    part = out.with_name(f".{out.name}.{os.getpid()}.part")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        if out.suffix.lower() == ".parquet":
            _parquet(part, columns)
        else:
            rows = np.stack(list(columns.values()), axis=1)
            np.savetxt(part, rows, "%.12g", ",", header=",".join(columns), comments="")
        part.replace(out)
    except OSError as error:
        raise RunError(f"{out}: {error.strerror or error}, the recording is not written") from error
    finally:
        part.unlink(missing_ok=True)


def _parquet(path: Path, columns: Mapping[str, Array]) -> None:
    import pyarrow  # noqa: PLC0415
    import pyarrow.parquet  # noqa: PLC0415

    pyarrow.parquet.write_table(pyarrow.table(dict(columns)), path)
