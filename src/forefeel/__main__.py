"""Entry point: exit 0 done, 1 the run failed, 2 the input was wrong; every failure is one line."""

# ruff: noqa: E402 - first of all a signal ends the process without a word of Python's
import signal

signal.signal(signal.SIGINT, signal.SIG_DFL)

import os
import sys
from contextlib import suppress
from typing import NoReturn

from forefeel.common.errors import ForefeelError, InputError, UnclearError
from forefeel.interrupt import leave
from forefeel.terminal import complain

_STOP_PRIORITY = 25
"""Of SCHED_FIFO: below the threads of the daemons that receive commands, at 30. Above them, the imports of
`forefeel estop` on the slave's host kept commands from the watchdog for more than 60 ms.
"""


def run() -> None:
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:  # closed: what is opened next, as a serial port, would take its number
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: PTH123, SIM115
    try:
        main()
    except SystemExit as ended:
        leave(ended.code if isinstance(ended.code, int) else 0)


def main() -> None:
    """Runs the command of `sys.argv` and always exits: code 2 on InputError, 1 on another ForefeelError, each
    one line on stderr; an OSError that names a file, as one too long or not to be read, is of the input, too.
    `estop` runs before typer is imported. On UnclearError (columns or units in doubt) the line repeats the
    command with the columns to add.
    """
    try:
        code = _stop() if sys.argv[1:2] == ["estop"] else _command()
    except UnclearError as error:
        words = iter(sys.argv[1:])
        given = [
            word for word in words if word.removeprefix("--") not in error.columns or not next(words, "")
        ]
        _complain(error.answered_by(*given), 2)
    except InputError as error:
        _complain(str(error), 2)
    except ForefeelError as error:
        _complain(str(error), 1)
    except OSError as error:
        where = "" if error.filename is None else f"{error.filename}: "
        _complain(f"{where}{error.strerror or error}", 2 if where else 1)
    else:
        sys.exit(code)


def _stop() -> int:
    """Runs `forefeel estop` before typer and what the other commands need are imported."""
    _go_first()
    from forefeel.estop import command  # noqa: PLC0415 - the imports go first, too

    command.run(sys.argv[2:])
    return 0


def _command() -> int | None:
    """Runs the command line of typer; returns the code of a `typer.Exit`, else None. Wrong usage prints one
    line and exits with typer's code. Errors of the command pass.
    """
    import typer  # noqa: PLC0415 - as in `_stop`

    from forefeel.cli import app  # noqa: PLC0415 - so that an import error of an extra is one line, too

    try:
        code: int | None = app(standalone_mode=False, prog_name="forefeel")
    except typer.TyperException as error:  # wrong usage, which typer itself would show in a box
        _complain(error.format_message(), error.exit_code)
    return code


def _go_first() -> None:
    """Takes priority over all but the daemons, which bring the stage to rest, where that is permitted.

    On a busy host imports alone took half a minute.
    """
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_STOP_PRIORITY))


def _complain(text: str, code: int) -> NoReturn:
    if text:  # empty where the help was shown instead
        complain(text)
    sys.exit(code)


if __name__ == "__main__":
    run()
