"""The vessel that the picture of the instrument shows: of a file, or of a recording."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated

from pydantic import Field, ValidationError

from forefeel.common.config import Settings, load_settings
from forefeel.common.settings import Segment

RECORDED = "vessel"
"""Name of the profile in the metadata table `run` of a recording."""
_FRICTION = {
    "valve_mn": ("presliding_hysteresis.force_n", 1e3),
    "rub_mn_per_mm": ("position_dependent_friction.force_per_length_n_m", 1.0),
}

Place = Annotated[float, Field(ge=-1e4, le=1e4)]
Radius = Annotated[float, Field(gt=0.0, le=1e3)]
Landmark = Annotated[str, Field(min_length=1, max_length=40)]


class VesselSettings(Settings):
    """The path of an axis in mm: radius of the lumen by position, position by landmark.

    `tip_mm`: where the tip is while the stage reads 0. Between two positions the radius changes smoothly; the
    wall is drawn as touched where the lumen is no wider than the instrument. The landmark `valve` is drawn as
    one. `to_scale` false: the radii only say where it is wider and narrower. `walls_mm`: x and y of the
    left wall, then of the right one, by position, in coordinates of the simulated world; drawn where the
    instrument's shape is known.
    """

    axis: Segment = "insertion"
    tip_mm: Place = 0.0
    instrument_radius_mm: Radius
    lumen_radius_mm: Annotated[dict[Place, Radius], Field(min_length=2, max_length=1000)]
    landmarks_mm: Annotated[dict[Landmark, Place], Field(default_factory=dict, max_length=50)]
    to_scale: bool = True
    walls_mm: dict[Place, tuple[Place, Place, Place, Place]] = Field(default_factory=dict, max_length=1000)


def vessel_of(path: Path | None) -> VesselSettings | None:
    """Raises ConfigurationError, one line, where the file is wrong."""
    return None if path is None else load_settings(VesselSettings, path)


def of_recording(metadata: Mapping[str, Mapping[str, str]]) -> VesselSettings | None:
    """The vessel of a run; None where its metadata hold none."""
    try:
        return VesselSettings.model_validate_json(metadata["run"][RECORDED])
    except (KeyError, ValidationError):
        return None


def friction(names: Iterable[str], values: Iterable[float], deviations: Iterable[float]) -> dict[str, float]:
    """Friction in mN at the valve and in mN per mm in contact, where it exceeds two deviations."""
    known = {n: value for n, value, sd in zip(names, values, deviations, strict=False) if abs(value) > 2 * sd}
    return {shown: scale * known[name] for shown, (name, scale) in _FRICTION.items() if name in known}
