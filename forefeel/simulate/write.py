"""A table of a recording: CSV or Parquet, there whole or not at all."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from forefeel.common.errors import ConfigurationError
from forefeel.common.recording.recording import Array
from forefeel.files import check_new_file, whole

SUFFIXES = (".csv", ".parquet")


def check_target(out: Path, overwrite: bool) -> None:
    """Refuses what can not be written, before anything is computed.

    Raises:
        ConfigurationError: another suffix, a folder, a file that may not go, or Parquet without pyarrow.
    """
    check_new_file(out, SUFFIXES, ".csv or .parquet", overwrite)
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
    with whole(out, "the recording") as part:
        if out.suffix.lower() == ".parquet":
            _parquet(part, columns)
        else:
            rows = np.stack(list(columns.values()), axis=1)
            np.savetxt(part, rows, "%.12g", ",", header=",".join(columns), comments="")


def _parquet(path: Path, columns: Mapping[str, Array]) -> None:
    import pyarrow  # noqa: PLC0415
    import pyarrow.parquet  # noqa: PLC0415

    pyarrow.parquet.write_table(pyarrow.table(dict(columns)), path)
