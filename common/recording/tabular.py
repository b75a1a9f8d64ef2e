"""Import of recordings from CSV, Parquet and MCAP files."""

from pathlib import Path

from forefeel.common.errors import RecordingError
from forefeel.common.recording.mcap_reader import read_run
from forefeel.common.recording.recording import Recording, check_samples
from forefeel.common.recording.tables import CsvTable, ParquetTable, Table
from forefeel.common.recording.units import Mapping

_TABLES: dict[str, type[CsvTable] | type[ParquetTable]] = {".csv": CsvTable, ".parquet": ParquetTable}


def load_recording(path: Path, mapping: Mapping | None = None, axis: str | None = None) -> Recording:
    """The recording in a .csv, .parquet or .mcap file.

    Without `mapping` a table has the columns `time_s`, `position_m` and, where it was measured, `force_n`.
    `axis` chooses one of an MCAP file; it may be left out when there is only one.

    Raises:
        RecordingError: one line that says where, which value, and what was expected.
    """
    suffix = path.suffix.lower()
    if suffix == ".mcap":
        if mapping is not None:
            raise RecordingError(
                f"{path}: a column mapping was given, expected one for .csv or .parquet only"
            )
        return read_run(path).to_recording(axis)
    if suffix not in _TABLES:
        raise RecordingError(f"{path}: suffix {suffix!r}, expected .csv, .parquet or .mcap")
    table = _TABLES[suffix](path)
    if mapping is None:
        mapping = Mapping(force="N:force_n" if "force_n" in table.names else None)
    return _from_table(table, mapping, path)


def _from_table(table: Table, mapping: Mapping, path: Path) -> Recording:
    columns = mapping.columns()
    for name, _ in columns:
        _check_column(table, name, path)
    # checked before the conversion: an error shows the values as the file has them
    raw = {name: table.numbers(name) for name, _ in columns}
    check_samples(raw, str(path), table.where)
    time_s, position_m, *force_n = (
        raw[name] * to_si if to_si != 1.0 else raw[name] for name, to_si in columns
    )
    return Recording(path.stem, time_s, position_m, force_n[0] if force_n else None, source=str(path))


def _check_column(table: Table, name: str, path: Path) -> None:
    found = list(table.names).count(name)
    if found == 0:
        raise RecordingError(f"{path}: no column {name!r}, it has {', '.join(map(repr, table.names))}")
    if found > 1:
        raise RecordingError(f"{path}: {found} columns are named {name!r}, expected one")
