"""The README's headline over packets, beside the injected run: `python -m benchmarks.headline` (as root).

`make demo` injects 150 +- 10 ms one way into the messages of two daemons on one host. Here the same world,
operator, seed and duration also run on two hosts whose IP packets are delayed so, over the default link with
certificates. Both without loss; 1 % loss each way is a comparison of its own.
"""

import argparse
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import mean
from tempfile import TemporaryDirectory

from benchmarks.linked import LINKS, Route, link_run
from benchmarks.links import command, listed, milliseconds, percent, ratio
from benchmarks.markdown import Table
from forefeel.common.config import checked
from forefeel.common.errors import RunError
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.transport.settings import ImpairmentSettings
from forefeel.loopback.plan import DEFAULT_DURATION_S, LoopbackOptions, make_plan
from forefeel.loopback.real import run_real
from forefeel.report.model import RunReport
from forefeel.report.score import PredictionComparison
from forefeel.report.summary import summarise
from forefeel.terminal import bar

COLUMNS = (
    "network", "loss, %", "seed", "prediction, mN rms", "ZOH, mN rms", "prediction / ZOH", "settled",
    "armed, %", "stops", "round trip p50 / p99, ms",
)  # fmt: skip
_IMPAIRMENT = "paper"
"""150 +- 10 ms one way: that of `make demo`, here without its loss."""
_PARTS: dict[str, Callable[[RunReport], PredictionComparison | RunReport]] = {
    "prediction / ZOH": lambda report: report,
    "settled": lambda report: report.settled,
}
DEMANDED = 0.10
"""By how much the ratio over packets may differ from that of the injected run."""


def main(words: Sequence[str]) -> None:
    """Prints each row as it comes, and the difference below."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.headline")
    parser.add_argument("--link", choices=tuple(LINKS), default="default")
    parser.add_argument("--losses", type=listed(percent), default="0,1", help="percent each way")
    parser.add_argument("--seconds", type=float, default=DEFAULT_DURATION_S, help="from the open session on")
    parser.add_argument("--seeds", type=listed(int), default="1", help="of operator, world and network")
    parser.add_argument("--out", type=Path, metavar="FILE", help="the table as a Markdown file, too")
    asked = parser.parse_args(words)
    table = Table(COLUMNS, command(parser, words), asked.out)
    below: list[str] = []
    for loss in asked.losses:
        injected, packets = list[RunReport](), list[RunReport]()
        for seed in asked.seeds:
            injected.append(run_injected(1e-2 * loss, asked.seconds, seed))
            table.add(["injected", f"{loss:g}", seed, *_figures(injected[-1])])
            packets.append(run_over_packets(asked.link, 1e-2 * loss, asked.seconds, seed))
            table.add([f"packets, {asked.link}", f"{loss:g}", seed, *_figures(packets[-1])])
        below.append(f"Loss {loss:g} %: {compared(injected, packets)}")
    table.line("\n" + "  \n".join(below))


def run_injected(loss: float, seconds: float, seed: int) -> RunReport:
    """Two daemons on this host, as `forefeel loopback` runs them; `loss` is a share, one way."""
    plan = make_plan(LoopbackOptions(seed=seed, duration_s=seconds))
    link = {"impairment": {"inbound": {"preset": _IMPAIRMENT, "loss": loss}, "seed": seed}}
    plan = replace(plan, slave=plan.slave | link, master=plan.master | link)
    with TemporaryDirectory(prefix="ff-") as folder:
        run_real(plan, Path(folder), bar(seconds), {})
        return summarise(Run(Path(folder) / "recording.mcap"))


def run_over_packets(link: str, loss: float, seconds: float, seed: int) -> RunReport:
    """Two hosts whose packets are delayed and lost as the messages of `run_injected` are."""
    settings = checked(ImpairmentSettings, {"preset": _IMPAIRMENT, "loss": loss}, "headline")
    with TemporaryDirectory(prefix="ff-") as folder:
        return link_run(Path(folder), LINKS[link], Route(settings, settings), seconds, seed).report


def compared(injected: Sequence[RunReport], packets: Sequence[RunReport]) -> str:
    """Both ratios over packets beside those injected, and by how much they differ; means over the seeds."""
    whole, settled = (
        _difference(name, *(_mean(part(run).ratio for run in runs) for runs in (packets, injected)))
        for name, part in _PARTS.items()
    )
    return f"{whole}; {settled}."


def _mean(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return mean(known) if known else None


def _difference(name: str, packets: float | None, injected: float | None) -> str:
    if packets is None or injected is None:
        return f"{name}: nothing scored"
    share = packets / injected - 1
    verdict = "within" if abs(share) <= DEMANDED else "not within"
    return (
        f"{name} {packets:.3f} over packets, {injected:.3f} injected: {100 * share:+.1f} %, "
        f"{verdict} {100 * DEMANDED:g} %"
    )


def _figures(report: RunReport) -> list[str]:
    return [
        millinewtons(report.prediction.rms_n),
        millinewtons(report.zoh.rms_n),
        ratio(report.ratio),
        ratio(report.settled.ratio),
        f"{100 * (report.armed_share or 0.0):.1f}",
        f"{report.stops}",
        " / ".join(milliseconds(each) for each in (report.delay_s.p50, report.delay_s.p99)),
    ]


def millinewtons(force_n: float | None) -> str:
    """With one digit."""
    return "-" if force_n is None else f"{1e3 * force_n:.1f}"


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except (AssertionError, RunError) as error:
        sys.exit(f"python -m benchmarks.headline: {error}")
