"""`python -m tests.system.faults [NAME...]`: the matrix, one table; exit 1 when a requirement is not met."""

import argparse
import os
import re
import shlex
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.system.faults import required
from tests.system.faults.cases import faults
from tests.system.faults.scene import Row, tried
from tests.system.net.service import CELL_HZ
from tests.witness import PRIORITY, Witness

HEAD = ("fault", "required s", "to rest s", "from mm/s", "stale commands executed", "oldest ms",
        "moved after rest um", "force faded s", "from N", "recovery", "armed again s", "recording", "events",
        "")  # fmt: skip
QUIET = 0.3
TEXT = """# What becomes of the stage at a fault

Research software, not a medical device.

Slave and master run as processes on two hosts (network namespaces of one machine), with certificates,
access control and the default number of parallel connections, over a cable in software that delays
packets below TCP: 10 ± 2 ms one way, 150 ± 2 ms in rows named "300 ms", which is the round trip. Where
stage and load cell are emulated, the cell gives {rate_hz:g} readings a second. While the synthetic
operator moves the stage in contact, one thing goes wrong. Measured by `{command}` (root) in
{took_min:.0f} min on {machine}.

{table}

- **required, to rest**: from the fault until the stage stays within 10 um for 0.1 s, and how fast it was;
  of several stops the slowest. Limits are derived from watchdog, ramp, drive and the cable's delay, each
  with its reason: [required.py](../../tests/system/faults/required.py). A cut takes what is under way,
  so its limit does not depend on the delay. Where the slave itself is struck, an emulated drive tells, which
  only ever has targets 60 ms ahead.
- **stale commands executed**: that were more than 100 ms older than the usual age of the same cable as
  they began to be executed; *oldest*: the most that any was.
- **moved after rest**: the most until the operator engaged again, which always took a released and newly
  pressed deadman.
- **force faded**: until the hand felt less than 5 mN. Empty where the master is gone, or nothing stopped.
  After a SIGSTOP of the master from its awakening on: before, it shows nothing new. In every row but
  those of wrong clocks the hand must also feel less than 5 mN soon after the last fresh force, which fades
  in {fade_ms:.0f} ms. A fresh one was measured at most {stale_ms:.0f} ms longer ago than usual, whenever it
  arrived.
- **armed again**: after the recovery, of which the operator's own pause is half a second.
- **round trip 20 -> 500 -> 20 ms**: all packets take 250 ms one way for some seconds. The slave stops,
  refuses what is late and opens a new session that measures the way anew; when the way is short again
  nothing stops.
- **200 ms there, 10 ms back**: the comparison of two clocks can not see this asymmetry. Its bound, half
  of the round trip, contains the error.
- **packets over 576 bytes dropped**: and nobody tells the sender. Single commands and forces pass; what
  TCP joins to a larger segment, and the handshake of TLS, does not, and the connection stands still. The
  cure is an MTU of that size on one of the two hosts (`ip link set DEVICE mtu 576`), for it bounds the
  segments of both.
- **half-open TCP**: the cable is cut, the master killed, and no packet of the old connections ever passes
  again, as behind a firewall that was started anew.
- **two masters at once**: a second master with the same certificate asks, is refused, and is then ended.
- **clock rate**: the clock that the master's daemon reads gains so much from then on; the host's clock is
  not touched. The slave names a rate beyond 1000 ppm when the past minute shows it throughout, after
  {named_s:.0f} s at most; ages of commands do not depend on that, for they are measured within a second.
- **recording, events**: both recordings read back; both event logs hold the events named; each
  flight record was opened and its cycles compared with the recording (readback, commands and their age).
- A row that did not hold says by how much the machine itself was late meanwhile: another process on the
  same two cores can hold up a thread for longer than a watchdog.
"""


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(prog="python -m tests.system.faults")
    parser.add_argument("names", nargs="*", help="parts of names; all without any")
    parser.add_argument("--keep", type=Path, help="a folder for recordings and logs")
    parser.add_argument(
        "--patience", type=float, default=60.0, help="s that a row waits at most for a quiet machine"
    )
    parser.add_argument(
        "--out", type=Path, help="the page, in Markdown; with names, only their rows of it are written anew"
    )
    wanted = parser.parse_args()
    if os.geteuid() != 0:
        sys.exit("tests.system.faults: making network namespaces needs root")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # in order: hosts and processes go
    rows, start_s, load = [], time.monotonic(), os.getloadavg()[0]
    for fault in faults():
        if wanted.names and not any(name in fault.name for name in wanted.names):
            continue
        _await_quiet(wanted.patience)
        with _folder(wanted.keep, fault.name) as folder, Witness(PRIORITY) as witness:
            row = tried(fault, folder)
        row.late_s = witness.late_s
        print("; ".join(line(row)), *row.failures, sep="\n    ", flush=True)
        rows.append(row)
    print(table(rows))
    command = shlex.join(["python", "-m", "tests.system.faults", *sys.argv[1:]])
    if wanted.out is not None and wanted.names:
        wanted.out.write_text(renewed(wanted.out.read_text(), rows, command))
    elif wanted.out is not None:
        took_min = (time.monotonic() - start_s) / 60.0
        words = {"command": command, "took_min": took_min, "machine": _machine(load), "rate_hz": CELL_HZ}
        words |= {
            "named_s": required.RATE_NAMED_S,
            "stale_ms": required.FORCE_STALE_S * 1e3,
            "fade_ms": required.FADE_S * 1e3,
        }
        wanted.out.write_text(TEXT.format(**words, table=table(rows)))
    sys.exit(any(row.failures for row in rows))


def _await_quiet(patience_s: float) -> None:
    """What else computes here falsifies times."""
    end_s = time.monotonic() + patience_s
    while _pressure() > QUIET and time.monotonic() < end_s:
        time.sleep(1.0)


def _pressure() -> float:
    """In what share of the last 10 s something waited for a processor; 0 where the kernel does not say."""
    path = Path("/proc/pressure/cpu")
    found = re.search(r"some avg10=([0-9.]+)", path.read_text()) if path.exists() else None
    return 0.0 if found is None else float(found[1]) / 100.0


@contextmanager
def _folder(keep: Path | None, name: str) -> Iterator[Path]:
    if keep is None:
        with TemporaryDirectory(prefix="ff-") as made:
            yield Path(made)
        return
    folder = keep / "".join(c if c.isalnum() or c in "+-" else "_" for c in name)
    folder.mkdir(parents=True)
    yield folder


def _machine(load: float) -> str:
    """What it was measured on, and what else ran there."""
    model = re.search(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    cores = f"{os.cpu_count()} cores{'' if model is None else f' of {model[1]}'}, Linux {os.uname().release}"
    return f"{cores}; load before it began {load:.1f}, at its end {os.getloadavg()[0]:.1f}"


def line(row: Row) -> tuple[str, ...]:
    """The cells of one row."""
    return (
        row.name,
        _number(row.asked_s, 3) or "goes on",
        _number(row.rest_s, 3),
        _number(row.speed_m_s * 1e3, 0),
        _number(row.stale, 0),
        _number(None if row.excess_s is None else row.excess_s * 1e3, 0),
        _number(None if row.moved_again_m is None else row.moved_again_m * 1e6, 0),
        _number(row.faded_s, 2),
        _number(row.force_n, 2),
        row.recovery,
        _number(row.armed_s, 1),
        row.recording,
        row.logged,
        f"FAILED; the machine was late by {1e3 * row.late_s:.0f} ms" if row.failures else "as required",
    )


def table(rows: Sequence[Row]) -> str:
    """In Markdown."""
    lines = [HEAD, tuple("---" for _ in HEAD), *map(line, rows)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def renewed(page: str, rows: Sequence[Row], command: str) -> str:
    """A page with these rows in place of those of the same names, or behind the last, and how they were
    measured.
    """
    lines = page.splitlines()
    at = {text.split(" | ")[0].removeprefix("| "): number for number, text in enumerate(lines)}
    last = max(number for number, text in enumerate(lines) if text.startswith("| "))
    for row in rows:
        text = f"| {' | '.join(line(row))} |"
        if row.name in at:
            lines[at[row.name]] = text
        else:
            last += 1
            lines.insert(last, text)
    note = f"Measured since, by `{command}`: {'; '.join(row.name for row in rows)}."
    return "\n".join([*lines[: last + 1], "", note, *lines[last + 1 :]]) + "\n"


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


if __name__ == "__main__":
    main()
