"""docs/explanation/faults.md: the table of the faults and what its columns mean."""

import os
import re
from collections.abc import Sequence
from pathlib import Path

from tests.system.faults import required
from tests.system.faults.scene import Row
from tests.system.net.service import CELL_HZ

HEAD = ("fault", "required s", "to rest s", "from mm/s", "stale commands executed", "oldest ms",
        "moved after rest um", "force faded s", "from N", "recovery", "armed again s", "recording", "events",
        "")  # fmt: skip
TEXT = """# What becomes of the stage at a fault

Research software, not a medical device.

Slave and master run as processes on two hosts (network namespaces of one machine), with certificates,
access control and the default number of parallel connections, over a cable in software that delays
packets below TCP: 10 ± 2 ms one way, 150 ± 2 ms in rows named "300 ms", which is the round trip. Where
stage and load cell are emulated, the cell gives {rate_hz:g} readings a second. While the synthetic
operator moves the stage in contact, one thing goes wrong. Measured by `make system`
on {machine}: {measured}.

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
  flight record is whole and its cycles lead up to the fault.
"""


def cells(row: Row) -> tuple[str, ...]:
    """In the order of HEAD."""
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
        "FAILED" if row.failures else "as required",
    )


def written(
    page: Path, measured: Sequence[tuple[str, ...]], names: Sequence[str], command: str, took_min: float
) -> str:
    """The page with these rows; those of it that were not measured now, but still exist, stay as they are."""
    old = page.read_text(encoding="utf-8").splitlines() if page.exists() else []
    kept = [tuple(line.strip("| ").split(" | ")) for line in old if line.startswith("| ")]
    rows = {row[0]: row for row in [*kept, *measured]}
    lines = [HEAD, tuple("---" for _ in HEAD), *(rows[name] for name in names if name in rows)]
    table = "\n".join(f"| {' | '.join(row)} |" for row in lines)
    now = f"{len(measured)} rows by `{command}` in {took_min:.0f} min"
    rest = ", the others in earlier runs" if len(measured) < len(names) else ""
    return TEXT.format(
        machine=_machine(), measured=now + rest, table=table,
        rate_hz=CELL_HZ, named_s=required.RATE_NAMED_S, stale_ms=required.FORCE_STALE_S * 1e3,
        fade_ms=required.FADE_S * 1e3,
    )  # fmt: skip


def _machine() -> str:
    model = re.search(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    return f"{os.cpu_count()} cores{'' if model is None else f' of {model[1]}'}, Linux {os.uname().release}"


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"
