"""Contact of an instrument in a patient, as it was learned: DIR/INSTRUMENT/PATIENT.json, one file each.

A file describes the patient, not the last session. Session i finds z_i = mean + day_i with its covariance
C_i, where day_i, of covariance D, is the spread between two sessions of one patient (`widened`). So z_i
measures the mean with covariance C_i + D: a file is merged from these by their information, and the next
session starts with the file's covariance + D. C_i knows of noise only; with D no session counts for more than
one.
"""

import json
import os
from contextlib import suppress
from dataclasses import asdict
from datetime import date
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from forefeel.common.config import checked
from forefeel.common.errors import ConfigurationError, RunError
from forefeel.common.estimation.contact_prior import ContactPrior, widened
from forefeel.common.estimation.path_force import PathForce
from forefeel.common.messages import MOST_PARAMETER, MOST_SECONDS, Name, Parameter
from forefeel.common.state.folder import own_file, sync_folder

SCHEMA = "forefeel.prior/1"
_MOST_NAMES = 64
_MOST_BYTES = 256 * 1024
"""64 x 64 covariances of 24 characters are 100 KB."""
_OTHER_PATIENT = 2.0
"""Spread between two patients over that between two sessions of one."""

Key = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")]
"""Name of an instrument, or the pseudonym of a patient."""
_Covariance = Annotated[float, Field(ge=-(MOST_PARAMETER**2), le=MOST_PARAMETER**2)]


class _Stored(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class _Keys(_Stored):
    instrument: Key
    patient: Key


class StoredPath(_Stored):
    """See `PathForce`."""

    low_m: Parameter
    step_m: Parameter
    length_m: Parameter
    elastic_n: tuple[Parameter, ...]
    friction_n: tuple[Parameter, ...]
    noise_n: Parameter


class StoredPrior(_Keys):
    """One file. `date`: of the newest of its `sessions`; for the other fields see `ContactPrior`."""

    date: date
    sessions: Annotated[int, Field(ge=1, le=10**9)]
    contact_s: Annotated[float, Field(ge=0.0, le=MOST_SECONDS)]
    names: Annotated[tuple[Name, ...], Field(min_length=1, max_length=_MOST_NAMES)]
    values: tuple[Parameter, ...]
    covariance: tuple[tuple[_Covariance, ...], ...]
    path: StoredPath | None = None

    @model_validator(mode="after")
    def _is_a_prior(self) -> Self:
        self.prior()
        return self

    @property
    def amount(self) -> str:
        return f"{self.sessions} session{'s' * (self.sessions > 1)}, {self.contact_s:.0f} s of contact"

    def prior(self) -> ContactPrior:
        path = None if self.path is None else PathForce(**self.path.model_dump())
        return ContactPrior(self.names, self.values, self.covariance, self.contact_s, path)


class Start(NamedTuple):
    """Prior that a session starts from, its origin in one line, and whose it is."""

    prior: ContactPrior
    origin: str
    patient: str


def prior_path(directory: Path, instrument: str, patient: str) -> Path:
    """The file, whether it exists or not.

    Raises:
        ConfigurationError: a key of other characters than A-Z, a-z, 0-9, _ and -, or of over 64.
    """
    checked(_Keys, {"instrument": instrument, "patient": patient}, "prior")
    return directory / instrument / f"{patient}.json"


def load_prior(path: Path) -> StoredPrior | None:
    """The prior in a file of `prior_path`, None where there is no file.

    Raises:
        ConfigurationError: unreadable, too large, not of this schema, not a covariance, or of another
            instrument or patient than its place says.
    """
    try:
        with path.open("rb") as file:
            text = file.read(_MOST_BYTES + 1)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise ConfigurationError(f"{path}: {error.strerror}; expected a readable prior") from error
    if len(text) > _MOST_BYTES:
        raise ConfigurationError(f"{path}: over {_MOST_BYTES // 1024} KiB; expected a prior")
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ConfigurationError(f"{path}: not JSON; expected a prior") from error
    schema = data.pop("schema", None) if isinstance(data, dict) else None
    if schema != SCHEMA:
        raise ConfigurationError(f"{path}: schema = {schema!r:.40}: expected {SCHEMA!r}")
    stored = checked(StoredPrior, data, str(path))
    if (stored.instrument, stored.patient) != (path.parent.name, path.stem):
        raise ConfigurationError(
            f"{path}: of instrument {stored.instrument}, patient {stored.patient}; "
            "expected those of its folder and name"
        )
    return stored


def nearest(directory: Path, instrument: str, patient: str) -> Start | None:
    """Start of a session from the patient's own prior with that instrument, else from that of the patient who
    had the instrument last; each widened, the latter more. None where there is neither. A mean of all would
    be no wall: vessels differ in where they are touched.

    Raises:
        ConfigurationError: a bad key, or a file of the instrument that can not be used.
    """
    old = load_prior(prior_path(directory, instrument, patient))
    if old is not None:
        return Start(widened(old.prior(), 1.0), f"{instrument}, patient {patient}: {old.amount}", patient)
    others = [other for path in sorted(directory.glob(f"{instrument}/*.json")) if (other := load_prior(path))]
    if not others:
        return None
    newest = max(others, key=lambda other: (other.date, other.contact_s))
    origin = f"{instrument}, of another patient, {newest.patient}: {newest.amount}"
    return Start(widened(newest.prior(), _OTHER_PATIENT), origin, newest.patient)


def keep_prior(
    directory: Path, instrument: str, patient: str, learned: ContactPrior, today: date
) -> StoredPrior:
    """Replaces what was stored of that instrument and patient by what a session that started from it learned;
    returns the new content, with one session more.

    A file is there as before or as new, whatever interrupts the write, for its owner alone.

    Raises:
        ConfigurationError: a bad key, or a file there that can not be used and stays as it is.
        RunError: it can not be written.
    """
    path = prior_path(directory, instrument, patient)
    before = load_prior(path)
    data = {
        "instrument": instrument,
        "patient": patient,
        "date": today,
        "sessions": 1 if before is None else before.sessions + 1,
        "contact_s": learned.contact_s,
        "names": learned.names,
        "values": learned.values,
        "covariance": learned.covariance,
        "path": None if learned.path is None else asdict(learned.path),
    }
    stored = checked(StoredPrior, data, str(path))
    _write(path, {"schema": SCHEMA, **stored.model_dump(mode="json")})
    return stored


def _write(path: Path, document: dict[str, Any]) -> None:
    """Writes the document as JSON, whole or not at all, on the disk when it returns; raises RunError where it
    can not. File and new folders are for their owner alone.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        path.parent.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        path.parent.mkdir(exist_ok=True, mode=0o700)
        try:
            with os.fdopen(own_file(part), "w", encoding="utf-8") as file:
                file.truncate()
                file.write(json.dumps(document) + "\n")
                file.flush()
                os.fsync(file.fileno())
            part.replace(path)
        except BaseException:
            with suppress(OSError):
                part.unlink()
            raise
        sync_folder(path.parent)
    except OSError as error:
        raise RunError(f"{path}: {error.strerror or error}, the prior is not written") from error
