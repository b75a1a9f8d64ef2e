"""The load-cell port: what the control loop needs of a force sensor."""

from collections.abc import Sequence
from typing import Annotated, ClassVar, NamedTuple, Protocol

from pydantic import Field

from forefeel.common.hardware.calibration import CellScale
from forefeel.common.hardware.driver import DriverSettings, Slot
from forefeel.common.hardware.link import DeviceLink
from forefeel.common.messages import MOST_FORCE_N

VALID_SHARE = 0.95
"""Share of full scale up to which a reading is to be believed: beyond it the cell saturates soon."""


FullScale = Annotated[float, Field(gt=0.0, le=MOST_FORCE_N)]
Native = Annotated[float, Field(gt=0.0, le=1e12)]
"""Rise of the device's number from no load to `full_scale_n`, by its data sheet."""


class LoadCellDriverSettings(DriverSettings):
    """Base of the settings of every load cell. One of hardware has a field `full_scale_n`.

    `filter_lag_s`: how late the amplifier's filter and the converter make a reading, which no stamp shows.
    `pushes_only`: nothing pulls the instrument inwards, so that a cell that says so while it goes in has the
    wrong sign: a fault. Not for an axis with inertia, gravity or friction on both sides, which does pull.
    """

    slot: ClassVar[Slot] = "load_cell"
    pushes_only: bool = False
    filter_lag_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0

    @property
    def rated_n(self) -> float | None:
        """The full scale in N; None where the settings do not say it."""
        return getattr(self, "full_scale_n", None)


class LoadCellReading(NamedTuple):
    """Force in N, the raw counts it comes from, whether to believe it (in range, no device error), and when
    it was made, by the host's clock; None: at the tick that reads it.
    """

    force_n: float
    raw_counts: int
    valid: bool
    stamp_ns: int | None = None


class LoadCell(Protocol):
    """Gives every reading of the device once, without waiting.

    Every method raises `DeviceError` when the device fails or is not open.

    Attributes:
        stale_s: a newest reading that is older than this is not to be believed any longer.
        full_scale_n: no reading is beyond it, whatever the device says; one that is is a fault.
    """

    stale_s: float
    full_scale_n: float

    def open(self) -> None: ...

    def close(self) -> None: ...

    def rearm(self) -> None:
        """Re-arms the device after a fault; without it the device stays failed."""
        ...

    def read(self, now_ns: int, recording_time_s: float | None) -> Sequence[LoadCellReading]:
        """The readings since the last call, oldest first; none when the device has made none.

        `recording_time_s` belongs to the command that the stage is executing; a physical cell ignores it, a
        recorded one answers with the force of that time.
        """
        ...


class NativeReading(NamedTuple):
    """Value that the device itself gives (N, counts, lbf/1000): before calibration, sign and tare; whether to
    believe it, and when it was made, by the host's clock.
    """

    native: float
    valid: bool
    stamp_ns: int


class NativeLoadCell(Protocol):
    """A load cell that can be calibrated.

    Attributes:
        scale: by its data sheet, known once it is open.
        link: its `serial` is what the calibration is bound to.
    """

    scale: CellScale
    link: DeviceLink

    def open_native(self) -> None:
        """Connects as `LoadCell.open` does, for `read_native` alone: the calibration is not looked at, and a
        cell that gives no force without one is taken as well.
        """
        ...

    def close(self) -> None: ...

    def read_native(self, now_ns: int) -> Sequence[NativeReading]:
        """The readings since the last call, oldest first, in place of `read`."""
        ...
