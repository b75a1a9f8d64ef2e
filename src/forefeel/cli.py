"""The command line. The module of a command, in `forefeel/commands`, is imported when its name is typed."""

from collections.abc import Iterator, Mapping
from functools import cache
from importlib import import_module, metadata
from inspect import getdoc
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from forefeel.commands.options import examples_of
from forefeel.terminal import show

COMMANDS = {
    "demo": "Show it all on this machine: a run 300 ms away, the diagnosis of what it lacked, and a run "
    "that knows it.",
    "devices": "List drivers, serial ports with their stable names, and CAN interfaces.",
    "doctor": "Check this host and these settings: green, amber, red, and what to do. "
    "Exit 1 when anything is red.",
    "estop": "Stop a cell, latched until `forefeel clear` on the slave's host. Exit 1: nothing confirmed it.",
    "clear": "Clear a latched emergency stop or fault: on the slave's host only, while the slave runs.",
    "slave": "Run the slave daemon: stage, load cell, safety gate.",
    "master": "Run the master daemon: handle, haptic loop, prediction.",
    "record": "Record a cell to MCAP until Ctrl-C, in a process of its own.",
    "metrics": "Serve what a cell says of itself to Prometheus, as a viewer in a process of its own.",
    "ros": "Show a cell to ROS 2 as CRTK topics, over DDS or Zenoh, as a viewer in a process of its own.",
    "dashboard": "Show a cell live in the browser, as a viewer in a process of its own, which commands "
    "nothing.",
    "view": "Show a recorded run in the same page, at any of its times.",
    "router": "Route between the ends of several cells, each kept to itself, until Ctrl-C.",
    "loopback": "Run master and slave on this machine, record, and report.",
    "evaluate": "Replay recordings across a delay: zero-order hold, the paper, m-b-k-bias and forefeel.",
    "resimulate": "Predict recorded sessions anew: this version beside the one that recorded them. Exit 1: "
    "worse, or not identical, where that was asked for.",
    "diagnose": "Show what the simulation gets wrong on a recording, name the cause, extend the model, "
    "measure the gain.",
    "investigate": "Ask for the motion that a recording leaves to be made, and judge the answer to it: named "
    "and confirmed, or why not.",
    "simulate": "Make a recording of any model: time_s, position_m, force_n.",
    "emulate": "Emulate a device at the level of its bytes, on a pseudo terminal or a CAN bus, until Ctrl-C.",
    "report": "Make the report of a run that was recorded before.",
    "config check": "Print the effective settings of a file, defaults included, or what is wrong with it.",
    "device probe": "Talk to each device: what it is, its rate and round trip, its link. Nothing is moved.",
    "calibrate load-cell": "Tare, then every weight up and down; gain and zero by least squares, residual, "
    "hysteresis.",
    "calibrate stage": "Home twice and go from end to end; asks before it moves. Take the instrument out.",
    "home": "Home a stage, as after its power was off; asks before it moves. Take the instrument out.",
    "pki init": "Make an authority and certificates for each host; again: add hosts, renew what ends soon.",
    "pki show": "Show names, hosts and expiry; exit 1 where one is red.",
}
"""In the order of the help, which is shown without importing any of them."""
SECTIONS = {
    "Start here": ("demo", "loopback --impairment paper", "diagnose run.csv"),
    "Run": (
        "slave --config slave.yaml", "master --config master.yaml",
        "record --config recorder.yaml --out run.mcap",
        "dashboard --connect tcp/10.0.0.2:7447", "metrics --connect tcp/10.0.0.2:7447",
        "ros --connect tcp/10.0.0.2:7447",
        "view run.mcap", "report run.mcap --out out",
    ),
    "Diagnose": ("investigate run.csv", "evaluate run.csv", "simulate --model catheter --out run.csv"),
    "Hardware": (
        "devices", "device probe --config slave.yaml", "calibrate load-cell --config slave.yaml",
        "home --config slave.yaml", "emulate zaber_ascii",
    ),
    "Safety": (
        "estop --config slave.yaml", "clear --config slave.yaml", "doctor --config slave.yaml",
        "config check slave.yaml",
    ),
    "Network": ("pki init pki --hosts slave=10.0.0.2", "router --config router.yaml"),
}  # fmt: skip
"""The help: an example of each command."""
GROUPS = {
    "config": "Settings.",
    "device": "The devices of a configuration.",
    "calibrate": "Dated calibration files of load cells and stages.",
    "pki": "Certificates of the cells of a laboratory.",
}


class _Commands(Mapping[str, Any]):
    """Commands of a group by name, each imported when it is asked for."""

    def __init__(self, group: str) -> None:
        self.prefix = f"{group} " if group else ""

    def __getitem__(self, name: str) -> Any:  # noqa: ANN401 - typer's own class, private to it
        if name not in set(self):
            raise KeyError(name)
        return _load(self.prefix + name)

    def __iter__(self) -> Iterator[str]:
        words = [name.removeprefix(self.prefix) for name in COMMANDS if name.startswith(self.prefix)]
        return iter(dict.fromkeys(word.partition(" ")[0] for word in words))

    def __len__(self) -> int:
        return sum(1 for _ in self)


class _Group(TyperGroup):
    """Group of commands whose help imports none of them."""

    def __init__(self, **attributes: Any) -> None:  # noqa: ANN401 - typer's
        super().__init__(**attributes)
        self.commands: Any = _Commands(attributes["name"] if attributes["name"] in GROUPS else "")
        self._in_help = False

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401
        """Shows the help where no command is given."""
        return super().parse_args(ctx, args or ["--help"])

    def format_help(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401
        """Writes the help with names and summaries of `COMMANDS`; no command's module is imported."""
        self._in_help = True
        try:
            super().format_help(ctx, formatter)
        finally:
            self._in_help = False

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401
        """Writes `SECTIONS`: a line for each example, with its command's summary; for a group, typer's."""
        if self.commands.prefix:
            super().format_commands(ctx, formatter)
            return
        for title, lines in SECTIONS.items():
            with formatter.section(title):
                names = [max(filter(line.startswith, COMMANDS), key=len) for line in lines]
                summaries = [COMMANDS[name].partition(". ")[0].rstrip(".") for name in names]
                formatter.write_dl([*zip(lines, summaries, strict=True)])

    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ANN401
        """Names in the order of `COMMANDS`; typer's own would import each of them."""
        return list(self.commands)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:  # noqa: ANN401
        """Command with its options; while the help is written, with its summary alone."""
        if not self._in_help:
            return super().get_command(ctx, cmd_name)
        words = self.commands.prefix + cmd_name
        return TyperCommand(cmd_name, short_help=COMMANDS.get(words) or GROUPS[words])


@cache
def _load(words: str) -> Any:  # noqa: ANN401 - typer's own class
    """Makes typer's command of `words`, a key of `COMMANDS` such as `pki show`: imports its function, and
    adds help, docstring and examples. Makes a group of a name in `GROUPS`. Cached.
    """
    if words in GROUPS:
        return typer.main.get_command(_group(words, GROUPS[words]))
    module, _, name = words.partition(" ")
    place = import_module(f"forefeel.commands.{module}")
    function = getattr(place, (name or module).replace("-", "_"))
    more = getdoc(function)
    alone = typer.Typer(add_completion=False, rich_markup_mode=None)
    alone.command(
        name or module,
        help=COMMANDS[words] + (f"\n\n{more}" if more else ""),
        epilog="\n".join(["\b", *(f"Example: {line}" for line in examples_of(function))]),
    )(function)
    return typer.main.get_command(alone)


def _group(name: str, words: str) -> typer.Typer:
    made = typer.Typer(name=name, cls=_Group, add_completion=False, rich_markup_mode=None)
    made.callback(help=words)(lambda: None)
    return made


def _version(wanted: bool) -> None:
    if wanted:
        show(f"forefeel {metadata.version('forefeel')}")
        raise typer.Exit


app = typer.Typer(
    name="forefeel",
    cls=_Group,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # help in boxes would take as long again
)


@app.callback(help="Contact force now, not after the network. Research software, not a medical device.")
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    del version  # typer has called `_version`
