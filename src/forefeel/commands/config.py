"""`forefeel config`: settings."""

from pathlib import Path
from typing import Annotated, Any

import typer

from forefeel.commands.options import AsJson, Quiet, examples
from forefeel.common.config import dump_yaml
from forefeel.common.limiter import claim
from forefeel.daemon_settings import load_any
from forefeel.terminal import answer, output, say, suggest

_NEXT = {"slave": "doctor", "master": "doctor", "recorder": "record", "viewer": "dashboard"}
"""By role; the doctor looks at what a file does not say: certificates, devices, this host."""


@examples("forefeel config check deploy/config/slave.yaml")
def check(
    file: Annotated[Path, typer.Argument(metavar="FILE")], as_json: AsJson = False, quiet: Quiet = False
) -> None:
    settings = load_any(file)
    with output(as_json, quiet):
        answer(dump_yaml(settings).rstrip("\n"), document=lambda: settings.model_dump(mode="json"))
        if not as_json:
            _verdict(file, settings)


def _verdict(file: Path, settings: Any) -> None:  # noqa: ANN401 - settings of any role
    """Prints on stderr that the file is valid: role, cells, axes with their limits, certificates, caveats,
    for a slave the speed up to which its force limit holds; then the command to type next. `settings`: of any
    role.
    """
    role, pki = settings.role, settings.transport.pki
    cells = settings.cells if role == "router" else [settings.cell]
    axes = "".join(f", axis {axis.name}{axis.limits.meaning}" for axis in getattr(settings, "axes", ()))
    links = f"certificates in {pki}" if pki else "no certificates"
    if not (settings.transport.listen or settings.transport.connect):
        links = "no endpoint yet: add one to transport.listen or transport.connect"
    say(f"Verdict  valid: {role} of {'cells' if cells[1:] else 'cell'} {', '.join(cells)}{axes}; {links}")
    for axis in getattr(settings, "axes", ()):
        for caveat in axis.caveats:
            say(f"         axis {axis.name}: {caveat}")
    for axis in settings.axes if role == "slave" else ():
        say(f"Axis {axis.name}  {claim(axis.limits, axis.reaction())}, as measured when it arms")
    command = _NEXT.get(role, role)
    suggest(command, config=file, out="run.mcap" if command == "record" else None)
