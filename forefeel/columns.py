"""The columns of a table as a user names them on the command line."""

from forefeel.common.recording.units import Mapping

Columns = tuple[str | None, str | None, str | None]
"""Time, position, force, each as `unit:column`; None where the user named none."""


def mapping_of(columns: Columns) -> Mapping | None:
    """A mapping when the user named any column; the others have their canonical names."""
    time, position, force = columns
    if time is None and position is None and force is None:
        return None
    return Mapping(time or "s:time_s", position or "m:position_m", force or "N:force_n")
