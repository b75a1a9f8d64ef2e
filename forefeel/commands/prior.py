"""`forefeel prior`: what was learned of the contact of each instrument and patient."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from forefeel.commands.options import AsJson, Quiet, examples
from forefeel.common.errors import ConfigurationError
from forefeel.terminal import answer, output, table, warn
from forefeel.terminal import show as say

if TYPE_CHECKING:
    from forefeel.common.prior_file import StoredPrior

Folder = Annotated[Path, typer.Option("--dir", metavar="DIR", help="The folder of priors.")]
Instrument = Annotated[str, typer.Option(metavar="NAME", help="As `forefeel prior list` names it.")]
Patient = Annotated[str, typer.Option(metavar="NAME", help="The patient's pseudonym.")]
_NUMBERS = "contact s", "sessions", "value", "standard deviation"


@examples("forefeel prior list --dir priors")
def list(folder: Folder, as_json: AsJson = False, quiet: Quiet = False) -> None:
    from forefeel.common.prior_file import stored_priors  # noqa: PLC0415 - the help needs none of it

    if not folder.is_dir():
        raise ConfigurationError(f"--dir {folder}: expected a folder of priors")
    with output(as_json, quiet):
        shown = table("instrument", "patient", "date", "contact s", "sessions", right=_NUMBERS)
        rows = []
        for found in stored_priors(folder):
            if isinstance(found, ConfigurationError):
                warn(str(found))
                continue
            row = _summary(found)
            rows.append(row)
            contact_s, sessions = f"{found.contact_s:.0f}", str(found.sessions)
            shown.add_row(row["instrument"], row["patient"], row["date"], contact_s, sessions)
        answer(shown, document=lambda: rows)


@examples("forefeel prior show --dir priors --instrument catheter --patient B")
def show(
    folder: Folder, instrument: Instrument, patient: Patient, as_json: AsJson = False, quiet: Quiet = False
) -> None:
    """The standard deviation is that of the mean of the patient's sessions."""
    from forefeel.common.prior_file import load_prior, prior_path  # noqa: PLC0415

    path = prior_path(folder, instrument, patient)
    stored = load_prior(path)
    if stored is None:
        raise ConfigurationError(f"{path}: No such file; expected a prior")
    rows: Sequence[dict[str, Any]] = [
        {"name": name, "value": value, "standard_deviation": deviation}
        for name, value, deviation in zip(
            stored.names, stored.values, stored.prior().standard_deviations, strict=True
        )
    ]
    with output(as_json, quiet):
        shown = table("parameter", "value", "standard deviation", right=_NUMBERS)
        for row in rows:
            shown.add_row(row["name"], f"{row['value']:.4g}", f"{row['standard_deviation']:.2g}")
        line = f"{instrument}, patient {patient}, {stored.date.isoformat()}: {stored.amount}"
        answer(line, shown, document=lambda: {**_summary(stored), "parameters": rows})


@examples("forefeel prior forget --dir priors --instrument catheter --patient B")
def forget(folder: Folder, instrument: Instrument, patient: Patient) -> None:
    """A file that is spoiled goes as well."""
    from forefeel.common.prior_file import forget_prior  # noqa: PLC0415

    say(f"removed {forget_prior(folder, instrument, patient)}")


def _summary(stored: "StoredPrior") -> dict[str, Any]:
    return stored.model_dump(mode="json", include={"instrument", "patient", "date", "contact_s", "sessions"})
