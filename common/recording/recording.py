"""A recording: one axis of motion over time, with or without the measured force, as it was sampled."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from forefeel.common.errors import RecordingError
from forefeel.common.estimation.state_filter import GAP_S
from forefeel.common.events.console import printable
from forefeel.common.events.text import quantity, table_html, units_of
from forefeel.common.recording.units import Quantity, is_angle

Array = NDArray[np.float64]

_ROUNDING_S = 1e-6  # s, rounding of stamps: a 10 Hz recording is no row of gaps of 0.1 s

_LEAST_ROOM_BYTES = 16 * 2**20  # bytes that any compressed file may unpack to, see `room_of`
_MOST_CHARACTERS = 200  # of a library's text in an error
_MOST_EXPANSION = 100  # unpacked bytes for each byte of a compressed file, see `room_of`


def room_of(path: Path) -> int:
    """Bytes that a compressed file may unpack to (of a table: each column): 16 MiB and 100 times its size.

    16 MiB are half an hour of a column at 1 kHz, whatever it holds. A hundredfold is beyond any measurement:
    noise is a byte of each eight of a number, and the JSON of a message shrinks some tenfold.
    """
    return _LEAST_ROOM_BYTES + _MOST_EXPANSION * path.stat().st_size


def require_room(path: Path, size: int, what: str = "") -> None:
    """Raises RecordingError where `size` bytes are more than `room_of` allows, before they are taken."""
    if size > (room := room_of(path)):
        raise RecordingError(f"{path}{what}: {size} bytes when unpacked, allowed {room}")


def unpacked(path: Path, decompressor: Callable[[], Any], packed: bytes) -> bytes:
    """Bytes without the compression of zlib, bz2 or lz4; raises RecordingError as `require_room` does."""
    data: bytes = decompressor().decompress(packed, room_of(path) + 1)
    require_room(path, len(data))
    return data


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """A further measured column, shape (n,): its name, its unit (rad, m, N, N m, degC), its values in it."""

    name: str
    unit: str
    values: Array


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Recording:
    """Position in m and force in N (None: not measured) at the stamps `time_s`; five lines when printed.

    All are float64, shape (n,), n >= 2, finite and read-only. Time increases strictly, its origin is free.
    `source` says where the samples come from, `columns` from which columns, each as `unit:column`, and
    `notes` what was left out or changed. `further`: what was measured beside, such as another axis.

    Raises:
        RecordingError: shapes that differ, fewer than 2 samples, a value that is not finite, time that
            repeats or goes back.
    """

    name: str
    time_s: Array
    position_m: Array
    force_n: Array | None
    source: str
    columns: Mapping[Quantity, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    further: tuple[Column, ...] = ()

    def __post_init__(self) -> None:
        columns = {"time_s": self.time_s, "position_m": self.position_m}
        if self.force_n is not None:
            columns["force_n"] = self.force_n
        for column, values in columns.items():
            object.__setattr__(self, column, _frozen(values))
        beside = {column.name: column.values for column in self.further}
        check_samples({**columns, **beside}, self.source, lambda index: f"{self.source}: sample {index}")

    def cut(self, part: slice | NDArray[np.bool_]) -> "Recording":
        """Recording of some of the samples, those that `part` selects."""
        columns = {key: getattr(self, key) for key in ("time_s", "position_m", "force_n")}
        some = {key: values[part] for key, values in columns.items() if values is not None}
        beside = tuple(replace(column, values=column.values[part]) for column in self.further)
        return replace(self, **some, further=beside)

    def __len__(self) -> int:
        return len(self.time_s)

    def __str__(self) -> str:
        x, f = self.position_m, self.force_n
        with units_of(self.columns):
            lines = {
                "Recording": f"{self.name}, from {self.source}",
                "Samples": f"{len(self)} in {self.duration_s:.1f} s, {self.rate_hz:.4g} Hz",
                "Columns": self.taken,
                "Position": f"{quantity(x.min(), 'm')} to {quantity(x.max(), 'm')}",
                "Force": "not measured",
            }
            if f is not None:
                lines["Force"] = f"{quantity(f.min(), 'N')} to {quantity(f.max(), 'N')}"
        return "\n".join(f"{label:<11} {text}" for label, text in lines.items() if text)

    __repr__ = __str__  # a notebook shows what a cell ends with

    def _repr_html_(self) -> str:
        return table_html(str(self))

    @property
    def taken(self) -> str:
        """Text, in one line, on the columns taken and what was changed; empty where there is nothing."""
        columns = ", ".join(f"{quantity} {text}" for quantity, text in self.columns.items())
        beside = ", ".join(column.name for column in self.further)
        return "; ".join(filter(None, (columns, beside and f"beside {beside}", *self.notes)))

    @property
    def rotary(self) -> bool:
        """True where the position is an angle in rad, by the unit of its column."""
        return is_angle(self.columns.get("position", ""))

    @property
    def duration_s(self) -> float:
        """From the first to the last sample, gaps included."""
        return float(self.time_s[-1] - self.time_s[0])

    @property
    def sampled_s(self) -> float:
        """`duration_s` without the gaps, such as those between joined recordings."""
        pieces = self.segments(max(GAP_S, 2.0 / self.rate_hz))
        return sum(float(self.time_s[piece][-1] - self.time_s[piece][0]) for piece in pieces)

    @property
    def rate_hz(self) -> float:
        """The inverse of the median interval: gaps do not bias it."""
        return float(1.0 / np.median(np.diff(self.time_s)))

    def segments(self, gap_s: float = GAP_S) -> list[slice]:
        """The pieces without an interval longer than `gap_s`, in order; together they hold every sample.

        Nothing may interpolate, differentiate or filter across their borders. A piece can be a single sample.
        """
        after = np.flatnonzero(np.diff(self.time_s) > gap_s + _ROUNDING_S) + 1
        edges = [0, *after.tolist(), len(self)]
        return [slice(start, stop) for start, stop in pairwise(edges)]


def joined(recordings: Sequence[Recording], apart_s: float) -> Recording:
    """Joins recordings, all with a force, in turn: stamps from 0, `apart_s` between two; only further columns
    that all have.
    """
    first, *more = recordings
    stamps, now_s = [], 0.0
    for recording in recordings:
        stamps.append(recording.time_s - recording.time_s[0] + now_s)
        now_s = float(stamps[-1][-1]) + apart_s
    shared = [c for c in first.further if all(c.name in {d.name for d in r.further} for r in more)]
    return Recording(
        ", ".join(r.name for r in recordings),
        np.concatenate(stamps),
        np.concatenate([r.position_m for r in recordings]),
        np.concatenate([r.force_n for r in recordings if r.force_n is not None]),
        ", ".join(r.source for r in recordings),
        first.columns,
        further=tuple(
            replace(
                c,
                values=np.concatenate([d.values for r in recordings for d in r.further if d.name == c.name]),
            )
            for c in shared
        ),
    )


def check_samples(columns: Mapping[str, Array], source: str, where: Callable[[int], str]) -> None:
    """Checks the samples of a recording; the first column is time, `where` names the place of a sample.

    Raises:
        RecordingError: shapes that differ, fewer than 2 samples, a value that is not finite, time that
            repeats or goes back.
    """
    name, time = next(iter(columns.items()))
    for column, values in columns.items():
        if values.shape != (len(time),):
            raise RecordingError(
                f"{source}: {column} has shape {values.shape}, expected ({len(time)},) as {name}"
            )
    if len(time) < 2:
        raise RecordingError(f"{source}: {len(time)} sample(s), expected at least 2")
    for column, values in columns.items():
        for index in np.flatnonzero(~np.isfinite(values))[:1]:
            raise RecordingError(
                f"{where(index)}, column {column!r}: {values[index]}, expected a finite number"
            )
    for index in np.flatnonzero(np.diff(time) <= 0)[:1] + 1:
        now, before = float(time[index]), float(time[index - 1])
        raise RecordingError(
            f"{where(index)}, column {name!r}: {now!r} after {before!r}, expected time to increase"
        )


@contextmanager
def opened(path: Path) -> Iterator[BinaryIO]:
    """Context with the file open for reading, in binary; an OSError in its body becomes a RecordingError.

    Raises:
        RecordingError: missing, a directory, not permitted, unreadable, or empty.
    """
    try:
        with path.open("rb") as file:
            if not path.stat().st_size:
                raise RecordingError(f"{path}: empty file, expected a recording")
            yield file
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror or error}, expected a readable file") from error


def reason_of(error: BaseException) -> str:
    """The first line of a library's text, printable and short: it may hold bytes of the file."""
    lines = str(error).splitlines() or [type(error).__name__]
    return printable(lines[0][:_MOST_CHARACTERS])


def _frozen(values: ArrayLike) -> Array:
    """Read-only array, not copied where nobody can write to it: an hour at 1 kHz is 29 MB a column."""
    if isinstance(values, np.ndarray) and values.dtype == np.float64 and _fixed(values):
        return values
    copy = np.array(values, dtype=np.float64)
    copy.flags.writeable = False
    return copy


def _fixed(values: Array) -> bool:
    writeable_below = isinstance(values.base, np.ndarray) and values.base.flags.writeable
    return values.flags.c_contiguous and not values.flags.writeable and not writeable_below
