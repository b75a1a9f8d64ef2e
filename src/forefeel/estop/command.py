"""`forefeel estop`: an emergency stop, by the daemon beside us, else over the network.

What it imports up to the answer of that daemon is the standard library and a reader of YAML: a stop waits for
no other import, and for none that fails (docs/decisions/0022). The network's side is in `stop`.
"""

import os
import sys
import time
from collections.abc import Sequence
from optparse import IndentedHelpFormatter, OptionParser
from pathlib import Path
from typing import NoReturn

from forefeel.common.errors import ConfigurationError, RunError, check_config_alone
from forefeel.common.events.console import printable
from forefeel.common.state.folder import unnamed_path
from forefeel.common.yaml_file import load_yaml
from forefeel.estop.client import Request, ask, reason_text
from forefeel.terminal import say, suggest

EXAMPLES = (
    "forefeel estop --config deploy/config/slave.yaml --reason 'catheter kinked'",
    "forefeel estop --cell cathlab --connect tls/10.0.0.1:7447 --pki pki",
)
_REASON = "asked for on the command line"
_PATIENCE_S = 2.0
"""For the daemon beside us, which answers within 1 s; one that hangs must not keep the network waiting."""


class _Formatter(IndentedHelpFormatter):
    """An example is a line of its own, to be copied."""

    def format_epilog(self, epilog: str | None) -> str:
        return f"\n{epilog}\n"


class _Parser(OptionParser):
    """Wrong usage is one line and exit code 2, as of every command."""

    def error(self, msg: str) -> NoReturn:
        raise ConfigurationError(msg)


PARSER = _Parser(
    "forefeel estop [OPTIONS]",
    description="Stop a cell, latched until `forefeel clear` on the slave's host. "
    "Exit 1: nothing confirmed it.",
    epilog="\n".join(f"Example: {line}" for line in EXAMPLES),
    formatter=_Formatter(),
)
PARSER.add_option("--config", metavar="FILE", help="Of slave or master: its socket, else the network.")
PARSER.add_option("--cell", help="Without --config: which cell.")
PARSER.add_option("--connect", action="append", metavar="ENDPOINT", help="Where; repeat it.")
PARSER.add_option("--axis", action="append", help="Over the network: which; every one that is heard.")
PARSER.add_option("--reason", default=_REASON, help="Stands in the event log.")
PARSER.add_option("--pki", metavar="DIR", help="Certificates of the role viewer.")
PARSER.add_option(
    "--through-router", action="store_true", default=False, help="What it connects to is a router."
)
PARSER.add_option(
    "--insecure", action="store_true", default=False, help="Do without certificates outside this host."
)


def run(words: Sequence[str]) -> None:
    options, others = PARSER.parse_args(list(words))
    if others:
        raise ConfigurationError(f"{others[0]}: unexpected, expected options only (forefeel estop --help)")
    estop(**vars(options))


def estop(  # noqa: PLR0913 - one parameter per option
    *,
    config: str | None,
    cell: str | None,
    connect: list[str] | None,
    axis: list[str] | None,
    reason: str,
    pki: str | None,
    through_router: bool,
    insecure: bool,
) -> None:
    """Stops a cell by its daemon on this host, else over the network, and prints the outcome. The network is
    used without `config`, or when no daemon of that file answers and stops. A daemon stops all its axes,
    whatever `axis` says.

    Raises:
        InputError: an option or a file is wrong, and no daemon beside us has stopped the cell.
        RunError: nothing confirmed it.
    """
    why = ""
    if config is not None:
        check_config_alone(cell is not None, connect, pki, through_router)
        try:
            if _stop_here(Path(config), reason):
                return
        except RunError as error:
            why = f"{error}; over the network, then"
    elif not (cell and connect):
        raise ConfigurationError("expected --config, or --cell and --connect")
    from forefeel.estop import network  # noqa: PLC0415 - pydantic and Zenoh, which a stop here does not need

    if config is not None:
        sender = network.sender_of(Path(config), insecure)
    else:
        sender = network.viewer(cell, connect or (), pki, through_router, insecure)
    if why:
        say(why)
    states = network.stop_over_network(sender, tuple(axis or sender.axes), reason)
    where = ", ".join(sender.transport.connect)
    _confirm(states, network.all_stopped(states), f"cell {sender.cell} at {where}")


def state_folder(config: Path) -> Path | None:
    """Returns the state folder of the daemon of that file, by its role, cell and `state.directory` alone.
    None where these are not those of a slave or master.

    Whatever else is wrong with the file keeps nobody from stopping.

    Raises:
        ConfigurationError: it is no YAML file of settings.
    """
    match {"cell": "cell", "state": {}, **load_yaml(config)[0]}:
        case {"role": "slave" | "master", "state": {"directory": str(directory)}}:
            return (config.parent / directory).absolute()
        case {"role": "slave" | "master" as role, "cell": str(cell), "state": dict(state)}:
            if state.get("directory") is None:
                return unnamed_path(cell, role, os.environ)
    return None


def _stop_here(config: Path, reason: str) -> bool:
    """Stops the cell by the daemon of that file on this host and prints its answer; True when it is stopped.
    False, and nothing is sent, where the file is of no daemon.

    Raises:
        ConfigurationError: it is no YAML file of settings.
        RunError: the daemon does not answer, or could not stop.
    """
    folder = state_folder(config)
    if folder is None:
        return False
    answer = ask(folder, Request("estop", reason_text(reason)), _PATIENCE_S)
    lines = [f"{answer.role}: {line}" for line in answer.text]
    if not answer.done:
        raise RunError("; ".join(lines))
    _tell(*lines, _stopped_text())
    if answer.role == "slave":
        suggest("clear", config=config)
    return True


def _confirm(states: dict[str, str], done: bool, whom: str) -> None:
    """Prints the state of each axis after a stop over the network, and if `done` that the cell is stopped.

    Raises:
        RunError: it is not confirmed (`done` is false); `whom`: cell and endpoints, for the text.
    """
    axes = [f"axis {axis}: {state}" for axis, state in states.items()]
    _tell(*axes, *[_stopped_text()] * done)
    if not done:
        states_text = ", ".join(axes) or "no slave heard"
        raise RunError(
            f"EMERGENCY STOP NOT CONFIRMED by {whom} in {_since_start_s():.1f} s ({states_text}): "
            "USE THE STOP OF THE MACHINE ITSELF"
        )


def _stopped_text() -> str:
    took_ms = _since_start_s() * 1e3
    return f"stopped in {took_ms:.0f} ms; latched until `forefeel clear` on the slave's host"


def _since_start_s() -> float:
    """Age of this process, imports included; up to 10 ms too much: the kernel rounds its start down."""
    fields = Path("/proc/self/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
    return time.clock_gettime(time.CLOCK_BOOTTIME) - int(fields[19]) / os.sysconf("SC_CLK_TCK")


def _tell(*lines: str) -> None:
    """Prints the lines on stdout; where that is full or closed on stderr, also for all later output."""
    text = "\n".join(map(printable, lines))
    try:
        print(text, flush=True)
    except OSError:
        sys.stdout = sys.stderr  # or the interpreter would fail at its end, which writes again
        say(text)
