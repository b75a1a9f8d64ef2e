"""`forefeel emulate`."""

from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.options import examples


@examples(
    "forefeel emulate zaber_ascii --port /tmp/stage",
    "forefeel emulate bota_serial --config slave.yaml --duration 60",
    "forefeel emulate can_hub --port /tmp/can-a,/tmp/can-b",
)
def emulate(
    device: Annotated[
        str,
        typer.Argument(
            metavar="DEVICE",
            help="zaber_ascii, bota_serial, ascii_line, coil_serial, cia402, cia404 or can_hub.",
        ),
    ],
    port: Annotated[
        str | None, typer.Option(metavar="LINK", help="Where it appears; can_hub: several, with commas.")
    ] = None,
    config: Annotated[
        Path | None, typer.Option(metavar="FILE", help="YAML of the daemon whose driver talks to it.")
    ] = None,
    axis: Annotated[str | None, typer.Option(metavar="NAME", help="Axis of that file.")] = None,
    feel: Annotated[
        Path | None, typer.Option(metavar="SOCKET", help="Joins an emulated stage and load cell.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, max=2**31 - 1, help="Of noise and operator.")] = 0,
    duration: Annotated[float | None, typer.Option(min=0.0, metavar="S", help="End after it.")] = None,
) -> None:
    """While it runs it obeys lines on stdin, from a terminal or a script: `load 1.5` hangs 1.5 N on a load
    cell (positive: resists insertion), `unplug`, `plug`, `stuck`, `overrange`, `drive_fault`, ... begin a
    fault, `free` ends one. A wrong line is answered on stderr with what that device takes. Stdin need not
    be open.
    """
    from forefeel.emulate.run import EmulatorOptions, run_emulator  # noqa: PLC0415 - the help needs none of it

    run_emulator(EmulatorOptions(device, port, config, axis, feel, seed), duration)
