"""How the service does over a lossy wide-area link, by what carries it: `python -m benchmarks.lossy_link`.

Two hosts as network namespaces (root), a forwarder of packets between them: 50 +- 5 ms each way and the loss
asked for, below Zenoh. `--links tls,tls-x8 --losses 0,0.5,2 --seconds 20 --seeds 1,2`, the losses in percent;
links are those of `tests.net.prediction`. One row a run.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.net.prediction import CABLE, LINKS, scored

HEAD = (
    "| link | loss, % | seed | armed, % | stops | round trip p50 / p99, ms | prediction / hold "
    "| packets/s there, back |"
)


def row(link: str, loss: float, seed: int, duration_s: float) -> str:
    """One run as a row of the table; a link that never opens is a row, too."""
    with TemporaryDirectory(prefix="ff-") as folder:
        try:
            report, packets = scored(Path(folder), link, duration_s, seed, **CABLE | {"loss": loss})
        except AssertionError as error:
            return f"| {link} | {100 * loss:g} | {seed} | no session: {str(error)[:60]} |"
    delay, ratio = report.delay_s, report.ratio.rms
    cells = (
        link,
        f"{100 * loss:g}",
        seed,
        f"{100 * (report.armed_share or 0.0):.1f}",
        report.stops,
        " / ".join("-" if each is None else f"{1e3 * each:.0f}" for each in (delay.p50, delay.p99)),
        "-" if ratio is None else f"{ratio:.2f}",
        ", ".join(f"{packets[way]['offered'] / duration_s:.0f}" for way in ("ab", "ba")),
    )
    return f"| {' | '.join(map(str, cells))} |"


def main(words: Sequence[str]) -> None:
    """Prints each row as it comes."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.lossy_link")
    parser.add_argument("--links", default="tls,tls-x8,tls-200,quic-mixed,udp")
    parser.add_argument("--losses", default="0.5", help="of packets each way, in percent")
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--seeds", default="1")
    asked = parser.parse_args(words)
    links = asked.links.split(",")
    if unknown := [link for link in links if link not in LINKS]:
        parser.error(f"link {unknown[0]!r}: expected one of {', '.join(LINKS)}")
    print(HEAD + "\n" + "|---" * 8 + "|")
    for link in links:
        for loss in asked.losses.split(","):
            for seed in asked.seeds.split(","):
                print(row(link, float(loss) / 100, int(seed), asked.seconds), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
