"""How long `forefeel estop` takes from the start of its process: `python -m benchmarks.stop`.

A slave with a simulated stage and certificates runs beside it, cleared before each stop. The ways take turns
with an interpreter that only prints a line, below which no command of ours can come; ratios are of one round.
As root the same commands are also given on another host, a network namespace whose packets take 10 ms each
way below TCP.
"""

import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import NamedTuple

from forefeel.common.state.folder import SOCKET
from tests.live_cell import free_port
from tests.secured import make_pki
from tests.system.net.hosts import ADDRESSES, joined_by_tun

_ROUNDS = 21  # rounds, an odd number for the median
_ONE_WAY_S = 0.010  # s that a packet takes each way
_PORT = 7447  # TCP port at which the slave listens: Zenoh's default
_START_S = 20.0  # s until the slave must serve its socket
_SETTLE_S = 3.0
"""A slave serves its socket before its devices are calm."""
_INSTALLED = Path(sys.executable).with_name("forefeel")
_FOREFEEL = [str(_INSTALLED)] if _INSTALLED.exists() else [sys.executable, "-m", "forefeel"]


class Took(NamedTuple):
    """One process: user and system time, and from its start to its first line; s."""

    processor_s: float
    said_s: float


def main() -> None:
    """Prints one line a way."""
    with TemporaryDirectory() as folder:
        _table(_rounds(Path(folder), f"127.0.0.1:{free_port()}", beside=()))
    if os.geteuid() != 0:
        print("from another host: not measured, for making network namespaces needs root")
        return
    with TemporaryDirectory() as folder, joined_by_tun(Path(folder)) as (hosts, cable):
        for way in ("ab", "ba"):
            cable.shape(way, delay_s=_ONE_WAY_S)
        slave, other = (("ip", "netns", "exec", name) for name in hosts.names)
        print(f"\nfrom another host, {2e3 * _ONE_WAY_S:g} ms round trip")
        _table(_rounds(Path(folder), f"{ADDRESSES[0]}:{_PORT}", within=slave, beside=other))


def _rounds(
    folder: Path, address: str, *, within: Sequence[str] = (), beside: Sequence[str]
) -> list[dict[str, Took]]:
    """What each way took in each round.

    Args:
        address: where the slave listens.
        within: what starts a process on the slave's host.
        beside: what starts the command on its host.
    """
    with _slave(folder, address, within) as endpoint:
        ways = {
            "an interpreter alone": [sys.executable, "-c", "print()"],
            "estop as a viewer, mTLS": [
                *_FOREFEEL, "estop", "--cell", "cell", "--connect", endpoint, "--pki", "pki",
            ],
            "estop as a master, mTLS": [*_FOREFEEL, "estop", "--config", "master.yaml"],
        }  # fmt: skip
        if not beside:
            ways |= {
                "estop --help": [*_FOREFEEL, "estop", "--help"],
                "estop on the slave's host": [*_FOREFEEL, "estop", "--config", "slave.yaml"],
            }
        return [
            {way: _once([*beside, *command], folder, within) for way, command in ways.items()}
            for _ in range(_ROUNDS)
        ]


def _table(rounds: Sequence[dict[str, Took]]) -> None:
    print(
        f"{'':>27} {'processor, ms':>15} {'ratio':>6} {'start to said, ms':>18} {'ratio':>6}\n"
        f"{'':>27} {'p50 / most':>15} {'p50':>6} {'p50 / most':>18} {'p50':>6}"
    )
    bare = next(iter(rounds[0]))
    for way in rounds[0]:
        cells = []
        for part, width in ((0, 15), (1, 18)):
            times_ms = [each[way][part] * 1e3 for each in rounds]
            ratio = median(each[way][part] / each[bare][part] for each in rounds)
            shown = f"{median(times_ms):.0f} / {max(times_ms):.0f}"
            cells.append(f"{shown:>{width}} {ratio:6.1f}")
        print(f"{way:>27} {' '.join(cells)}", flush=True)


def _once(command: Sequence[str], folder: Path, within: Sequence[str]) -> Took:
    """The command, after a clearing on the slave's host."""
    clear = [*within, *_FOREFEEL, "clear", "--config", "slave.yaml"]
    subprocess.run(clear, cwd=folder, capture_output=True, check=True)
    start_s = time.monotonic()
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        assert process.stdout is not None
        process.stdout.readline()
        said_s = time.monotonic() - start_s
        process.stdout.read()
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise SystemExit(f"{' '.join(command)}: exit code {process.returncode}")
    return Took(used.ru_utime + used.ru_stime, said_s)


@contextmanager
def _slave(folder: Path, address: str, within: Sequence[str]) -> Iterator[str]:
    """A slave that is ready; its endpoint."""
    make_pki(folder / "pki", ["cell"], {"slave": [address.partition(":")[0]]})
    endpoint = f"tls/{address}"
    settings = {"slave": ("listen", ""), "master": ("connect", "axes: [{handle: {driver: operator}}]\n")}
    for role, (side, axes) in settings.items():
        (folder / f"{role}.yaml").write_text(
            f"role: {role}\nstate: {{directory: {role}}}\n{axes}"
            f"transport: {{{side}: ['{endpoint}'], pki: pki}}\n"
        )
    command = [*within, *_FOREFEEL, "slave", "--config", "slave.yaml"]
    with subprocess.Popen(command, cwd=folder, stderr=subprocess.DEVNULL) as process:
        try:
            deadline_s = time.monotonic() + _START_S
            while not (folder / "slave" / SOCKET).exists():
                if time.monotonic() > deadline_s or process.poll() is not None:
                    raise SystemExit("the slave does not start")
                time.sleep(0.1)
            time.sleep(_SETTLE_S)
            yield endpoint
        finally:
            process.terminate()


if __name__ == "__main__":
    main()
