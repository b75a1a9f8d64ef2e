"""`forefeel devices`."""

from forefeel.commands.options import AsJson, Quiet, examples
from forefeel.terminal import output, suggest


@examples("forefeel devices", "forefeel devices --json")
def devices(as_json: AsJson = False, quiet: Quiet = False) -> None:
    from forefeel.probe.ports import run_devices  # noqa: PLC0415 - the help needs none of it

    with output(as_json, quiet):
        run_devices()
        suggest("device", "probe", "--help")
