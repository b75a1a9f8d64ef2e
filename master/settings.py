"""The master's YAML file: handle, prediction and rendering of each axis."""

from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, SerializeAsAny, model_validator

from forefeel.common.config import Settings, beside_the_file
from forefeel.common.hardware.driver import driver_settings
from forefeel.common.model_file import load_model
from forefeel.common.prior_file import Key
from forefeel.common.settings import (
    STOP_S,
    AxisSettings,
    Bound,
    DaemonSettings,
    ExistingFile,
)
from forefeel.common.topics import FORCE
from forefeel.common.transport.exposure import on_loopback
from forefeel.master.handle import HandleDriverSettings

HandleSection = Annotated[SerializeAsAny[HandleDriverSettings], driver_settings("handle")]


_OPERATOR: Any = {"driver": "operator"}  # read as if it stood in the file


class PredictionSettings(Settings):
    """Start of the prediction.

    `model`: a model.yaml of `forefeel diagnose`. `prior_dir`: a folder, relative to this file, that keeps
    what was learned of each `instrument` in each `patient` (a pseudonym) for the next session with them;
    null: nothing is kept.
    """

    model: ExistingFile | None = None
    prior_dir: Annotated[Path, AfterValidator(beside_the_file)] | None = None
    instrument: Key | None = None
    patient: Key | None = None

    @model_validator(mode="after")
    def _of_whom(self) -> Self:
        if self.prior_dir is not None and (self.instrument is None or self.patient is None):
            raise ValueError("prior_dir: expected instrument and patient beside it")
        return self


class RenderingSettings(Settings):
    """Force at the hand: scaled, limited in N and in N/s, faded to zero when the feedback is older than
    `stale_s`; and passive: see `forefeel.master.passivity`.

    `source`: the predicted force, or (to compare) the newest one that arrived. `max_stiffness_n_m`: of the
    spring as which a force may hold the hand that has not been pushed against; a hand and handle that damp
    with b N s/m stay stable below 2 b / T (Colgate and Schenkel 1997; T = 1 ms).
    """

    source: Literal["predicted", "zoh"] = "predicted"
    force_scale: Annotated[float, Field(gt=0, le=100)] = 1.0
    max_force_n: Annotated[float, Field(gt=0, le=50)] = 4.0
    max_slew_n_s: Annotated[float, Field(gt=0, le=10_000)] = 80.0
    max_stiffness_n_m: Annotated[float, Field(gt=0, le=100_000)] = 4000.0
    stale_s: Annotated[float, Field(gt=0, le=2)] = FORCE.stale_after_s or 0.1
    fade_s: Annotated[float, Field(gt=0, le=5)] = 0.2

    @model_validator(mode="after")
    def _fades_in_time(self) -> Self:
        """Raises ValueError where `fade_s` is shorter than the slew limit takes from the most force to 0."""
        shortest_s = self.max_force_n / self.max_slew_n_s
        if self.fade_s < shortest_s:
            raise ValueError(
                f"fade_s = {self.fade_s}: expected at least max_force_n / max_slew_n_s = {shortest_s:g}"
            )
        return self


_HAND_N = 12.0
"""The strongest of common desktop handles (omega.3)."""
_RISE_S = 0.01
"""From nothing to the largest force: shorter is a knock."""
_STIFFNESS_N_M = 10_000.0
"""Bound for a hand and handle that damp with 5 N s/m, at 1 kHz; see `RenderingSettings`."""


class MasterAxisSettings(AxisSettings):
    """One axis of the master. `limits` must equal the slave's."""

    handle: HandleSection = _OPERATOR
    prediction: PredictionSettings = PredictionSettings()
    rendering: RenderingSettings = RenderingSettings()

    @property
    def columns(self) -> tuple[str, ...]:
        return () if self.prediction.model is None else load_model(self.prediction.model).columns

    @property
    def bounds(self) -> tuple[Bound, ...]:
        """Ranges in which the rendering settings protect the hand: key, least, most, reason. Outside them a
        setting needs `unsafe` with a real handle.
        """
        return (
            ("rendering.max_force_n", 0.0, _HAND_N, "the strongest of desktop handles"),
            ("rendering.max_slew_n_s", 0.0, self.rendering.max_force_n / _RISE_S, "a blow"),
            ("rendering.max_stiffness_n_m", 0.0, _STIFFNESS_N_M, "it buzzes in a light hand"),
            ("rendering.stale_s", 0.0, STOP_S, "a force of another moment"),
            ("rendering.fade_s", 0.0, 2 * STOP_S, "a force that is gone"),
        )


class MasterSettings(DaemonSettings):
    """deploy/config/master.yaml. `peer_timeout_s`: how long a slave that does not answer is waited for; null:
    for ever. `accept_prior`: an axis starts from the prior of another patient where there is no other.
    """

    role: Literal["master"] = "master"
    peer_timeout_s: Annotated[float, Field(gt=0, le=86_400)] | None = 60.0
    accept_prior: bool = False
    axes: Annotated[tuple[MasterAxisSettings, ...], Field(min_length=1)] = (MasterAxisSettings(),)

    @model_validator(mode="after")
    def _priors_differ(self) -> Self:
        """Raises ValueError where two axes store one prior."""
        wanted = [axis.prediction for axis in self.axes if axis.prediction.prior_dir is not None]
        if len({(one.prior_dir, one.instrument, one.patient) for one in wanted}) < len(wanted):
            raise ValueError("axes: two keep one prior; expected another instrument for each")
        return self

    @model_validator(mode="after")
    def _hand_is_written_out(self) -> Self:
        """Raises ValueError where an axis names no handle though an address leaves this host: the stage there
        may be real, and the default is a synthetic operator.
        """
        far = not all(map(on_loopback, (*self.transport.listen, *self.transport.connect)))
        if far and any("handle" not in axis.model_fields_set for axis in self.axes):
            line = "handle: {driver: operator} # or another of `forefeel devices`"
            raise ValueError(f"axes: handle: missing, required outside this host; add the line {line}")
        return self
