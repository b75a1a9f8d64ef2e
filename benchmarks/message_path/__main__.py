"""`python -m benchmarks.message_path [--rounds N] [--json FILE]`: round trips at 1 kHz between two processes.

The ways take turns within each round, forth and back; a ratio is the median over the rounds of p50 to that
of bare Zenoh in the same round. The ways of forefeel decode, validate and gate each command before they
send it back; the others send bytes back unread.
"""

import argparse
import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from benchmarks.message_path.direct_ways import Grpc, ZeroMq
from benchmarks.message_path.ends import Way, summary
from benchmarks.message_path.zenoh_ways import (
    BareZenoh,
    GatedInCallback,
    Own,
    OwnAsyncio,
    SecuredOwn,
    SecuredZenoh,
)
from forefeel.common.runtime.realtime import prepare_process
from tests.secured import make_pki

WAYS: dict[str, type[Way]] = {
    way.__name__: way
    for way in (BareZenoh, SecuredZenoh, GatedInCallback, Own, SecuredOwn, OwnAsyncio, ZeroMq, Grpc)
}
_ROUNDS, _WARM_TRIPS, _TRIPS = 11, 500, 3000  # rounds; in each, round trips that are not counted and that are
_PLAIN = "BareZenoh"
Times = tuple[float, float, float, int]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.message_path")
    parser.add_argument("--rounds", type=int, default=_ROUNDS)
    parser.add_argument("--json", type=Path, help="the figures, too")
    options = parser.parse_args()
    found: dict[str, list[Times]] = {}
    missing: dict[str, str] = {}
    with TemporaryDirectory() as folder:
        pki = make_pki(Path(folder) / "pki")
        for number in range(options.rounds):
            for name in reversed(WAYS) if number % 2 else WAYS:
                try:
                    found.setdefault(name, []).append(_measured(name, pki))
                except ImportError as error:
                    missing[name] = str(error)
    rows = table(found)
    print(text(rows, missing))
    if options.json is not None:
        options.json.write_text(json.dumps({"rows": rows, "missing": missing}, indent=2))


def table(found: dict[str, list[Times]]) -> list[dict[str, object]]:
    """A row for each way: medians over the rounds."""
    plain = found[_PLAIN]
    rows: list[dict[str, object]] = []
    for name, kind in WAYS.items():
        if not (rounds := found.get(name)):
            continue
        ratios = [own[0] / other[0] for own, other in zip(rounds, plain, strict=True)]
        p50, p99, p999 = (median(each[at] for each in rounds) for at in range(3))
        way = kind(0, Path())
        rows.append({
            "way": way.name, "p50_us": p50, "p99_us": p99, "p999_us": p999, "ratio": median(ratios),
            "lost": sum(each[3] for each in rounds), "version": way.version(),
        })  # fmt: skip
    return rows


def text(rows: list[dict[str, object]], missing: dict[str, str]) -> str:
    """The table."""
    lines = [f"{'':>36} {'p50':>7} {'p99':>7} {'p99.9':>7} us {'ratio':>6} {'lost':>5}"]
    for row in rows:
        lines.append(
            f"{row['way']:>36} {row['p50_us']:7.0f} {row['p99_us']:7.0f} {row['p999_us']:7.0f}    "
            f"{row['ratio']:6.2f} {row['lost']:5}   {row['version']}"
        )
    lines += [f"{WAYS[name].name:>36} missing: {why}" for name, why in missing.items() if name in WAYS]
    return "\n".join(lines)


def _measured(name: str, pki: Path) -> Times:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    words = name, str(port), str(pki)
    with _echo(*words):
        command = [sys.executable, "-m", "benchmarks.message_path", "measure", *words]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    if done.returncode != 0:
        last = (done.stderr.splitlines() or ["nothing said"])[-1]
        if "ModuleNotFoundError" in last:
            raise ImportError(last)
        raise SystemExit(f"{name}: {last}")
    times_us = json.loads(done.stdout)
    if len(times_us) < _TRIPS // 2:
        raise SystemExit(f"{name}: {len(times_us)} answers of {_TRIPS}")
    return *summary(times_us), _TRIPS - len(times_us)


@contextmanager
def _echo(name: str, port: str, pki: str) -> Iterator[None]:
    command = [sys.executable, "-m", "benchmarks.message_path", "echo", name, port, pki]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        if not process.stdout.readline():
            _, said = process.communicate()
            last = (said.splitlines() or ["nothing said"])[-1]
            raise ImportError(last) if "ModuleNotFoundError" in last else SystemExit(f"{name}: {last}")
        try:
            yield
        finally:
            process.stdin.close()


def _end(what: str, name: str, port: str, pki: str) -> None:
    way = WAYS[name](int(port), Path(pki))
    prepare_process()
    if what == "echo":
        way.echo(lambda: print("ready", flush=True))
    else:
        print(json.dumps(way.measure(_WARM_TRIPS, _TRIPS)))


if __name__ == "__main__":
    if sys.argv[1:2] in (["echo"], ["measure"]):
        _end(*sys.argv[1:])
    else:
        main()
