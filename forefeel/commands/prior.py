"""`forefeel prior`: what was learned of the contact of each instrument and patient."""

from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.options import AsJson, Quiet, examples
from forefeel.common.errors import ConfigurationError
from forefeel.terminal import answer, output, suggest, table, warn

_SHOWN = {"instrument", "patient", "date", "contact_s", "sessions"}


@examples("forefeel prior list --dir priors")
def list(
    folder: Annotated[Path, typer.Option("--dir", metavar="DIR", help="The folder of priors.")],
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    from forefeel.common.prior_file import stored_priors  # noqa: PLC0415 - the help needs none of it

    if not folder.is_dir():
        raise ConfigurationError(f"--dir {folder}: expected a folder of priors")
    with output(as_json, quiet):
        shown = table(
            "instrument", "patient", "date", "contact s", "sessions", right=("contact s", "sessions")
        )
        rows = []
        for found in stored_priors(folder):
            if isinstance(found, ConfigurationError):
                warn(str(found))
                continue
            row = found.model_dump(mode="json", include=_SHOWN)
            rows.append(row)
            contact_s, sessions = f"{found.contact_s:.0f}", str(found.sessions)
            shown.add_row(row["instrument"], row["patient"], row["date"], contact_s, sessions)
        answer(shown, document=lambda: rows)
        suggest("loopback", prior_dir=folder, patient=rows[0]["patient"] if rows else None)
