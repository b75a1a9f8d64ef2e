"""How the service does over a network, by link, round trip and loss: `python -m benchmarks.links` (as root).

Two hosts as network namespaces, and a forwarder that delays and loses the IP packets between them. A row is
one run, 60 s from the opened session on. `--links tls,default`, of those in `benchmarks.linked`, or
`injected`: both daemons on this host, and their messages delayed and lost so. `--round-trips 300,200/10` in
ms (there/back where they differ; +-5 ms each way); `--losses 0,1` in percent each way. From 600 ms on
`gate.max_round_trip_s` is 1.0.
"""

import argparse
import shlex
import sys
from collections.abc import Callable, Sequence
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple, TypeVar

from benchmarks.linked import JITTER_S, LINKS, Route, injected_run, link_run, route
from benchmarks.markdown import Table
from forefeel.report.model import RunReport

COLUMNS = (
    "link", "round trip, ms", "loss, %", "seed", "open, s", "armed, %", "stops", "prediction / ZOH",
    "settled", "measured p50 / p99, ms", "packets/s there, back", "congestion control",
)  # fmt: skip
_INJECTED = "injected"
_LONGEST_MS = 10_000.0
"""One way: the most that the forwarder takes."""
T = TypeVar("T")


class Setting(NamedTuple):
    """One link over one network."""

    link: str
    there_ms: float
    back_ms: float
    loss_percent: float

    @property
    def route(self) -> Route:
        """For the cable."""
        return route(1e-3 * self.there_ms, 1e-3 * self.back_ms, 1e-2 * self.loss_percent)

    @property
    def cells(self) -> tuple[str, str, str]:
        """The first cells of a row."""
        delays = f"{self.there_ms:g}/{self.back_ms:g}"
        if self.there_ms == self.back_ms:
            delays = f"{self.there_ms + self.back_ms:g}"
        return self.link, delays, f"{self.loss_percent:g}"


def main(words: Sequence[str]) -> None:
    """Prints each row as it comes."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.links")
    add_options(parser, (*LINKS, _INJECTED), "default,tls,udp", "100,300,600,200/10")
    parser.add_argument("--seconds", type=float, default=60.0, help="of each run, from the open session on")
    parser.add_argument("--seeds", type=listed(int), default="1", help="of operator, world and cable")
    asked = parser.parse_args(words)
    table = Table(COLUMNS, command(parser, words), asked.out)
    for setting, seed in product(settings(asked), asked.seeds):
        table.add(row(setting, seed, asked.seconds, asked.congestion))


def row(setting: Setting, seed: int, seconds: float, congestion: str | None) -> list[str]:
    """One run; a link over which no session opens is a row, too."""
    with TemporaryDirectory(prefix="ff-") as folder:
        if setting.link == _INJECTED:
            report = injected_run(Path(folder), setting.route, seconds, seed)
            return [*setting.cells, str(seed), "-", *_figures(report), "-", "-"]
        try:
            run = link_run(Path(folder), LINKS[setting.link], setting.route, seconds, seed, congestion)
        except AssertionError as error:
            return [*setting.cells, str(seed), str(error)]
    packets_s = ", ".join(f"{run.packets_s(way):.0f}" for way in ("there", "back"))
    opened = [*setting.cells, str(seed), f"{run.open_s:.1f}"]
    return [*opened, *_figures(run.report), packets_s, run.congestion]


def _figures(report: RunReport) -> list[str]:
    return [
        f"{100 * (report.armed_share or 0.0):.1f}",
        f"{report.stops}",
        ratio(report.ratio),
        ratio(report.settled.ratio),
        " / ".join(milliseconds(each) for each in (report.delay_s.p50, report.delay_s.p99)),
    ]


def ratio(value: float | None) -> str:
    """Prediction over zoh."""
    return "-" if value is None else f"{value:.2f}"


def milliseconds(value_s: float | None) -> str:
    """Whole ones."""
    return "-" if value_s is None else f"{1e3 * value_s:.0f}"


# --- options ---


def add_options(parser: argparse.ArgumentParser, links: Sequence[str], usual: str, round_trips: str) -> None:
    """Those of every benchmark over packets; `usual`: the links that are measured without a word."""

    def link(text: str) -> str:
        if text not in links:
            raise argparse.ArgumentTypeError(f"{text!r}: expected one of {', '.join(links)}")
        return text

    parser.add_argument("--links", type=listed(link), default=usual, help=", ".join(links))
    parser.add_argument("--round-trips", type=listed(_delays), default=round_trips, help="ms, or there/back")
    parser.add_argument(
        "--losses", type=listed(percent), default="0,0.1,1", help="percent of packets each way"
    )
    parser.add_argument("--congestion", help="control of both hosts, such as reno; default: this machine's")
    parser.add_argument("--out", type=Path, metavar="FILE", help="the table as a Markdown file, too")


def settings(asked: argparse.Namespace) -> list[Setting]:
    """All that `add_options` asks for, in order."""
    return [
        Setting(link, there_ms, back_ms, loss)
        for link, (there_ms, back_ms), loss in product(asked.links, asked.round_trips, asked.losses)
    ]


def command(parser: argparse.ArgumentParser, words: Sequence[str]) -> str:
    """What was typed."""
    return shlex.join([*parser.prog.split(), *words])


def listed(one: Callable[[str], T]) -> Callable[[str], list[T]]:
    """Reads values with commas between them."""

    def read(text: str) -> list[T]:
        return [one(each) for each in text.split(",")]

    read.__name__ = "list"  # argparse names it where a ValueError is raised
    return read


def _delays(text: str) -> tuple[float, float]:
    """Both one-way delays in ms."""
    try:
        values = [float(each) for each in text.split("/")]
    except ValueError:
        values = []
    delays = [values[0] / 2] * 2 if len(values) == 1 else values
    if len(delays) != 2 or not all(1e3 * JITTER_S <= each <= _LONGEST_MS for each in delays):
        raise argparse.ArgumentTypeError(
            f"{text!r}: expected a round trip in ms, or there/back such as 200/10, "
            f"with {1e3 * JITTER_S:g} to {_LONGEST_MS:g} ms one way"
        )
    return delays[0], delays[1]


def percent(text: str) -> float:
    """A share of packets that are lost."""
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value < 100:
        raise argparse.ArgumentTypeError(f"{text!r}: expected percent, 0 or more and below 100")
    return value


if __name__ == "__main__":
    main(sys.argv[1:])
