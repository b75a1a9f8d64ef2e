"""Start of the daemons and of a loopback, memory, speed of virtual time: `python -m benchmarks.service`."""

import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from forefeel.loopback.plan import LoopbackOptions, Plan, make_plan
from forefeel.loopback.real import with_state
from forefeel.loopback.virtual import VirtualLoopback

_STREAMING_S = 8.0  # s of streaming before memory is read
_STARTS = 5
_VIRTUAL_S = 60.0  # s of virtual time
_ENDPOINT = "tcp/127.0.0.1:17447"
_READY = {"slave": "waiting for a master", "master": "session open"}


def main() -> None:
    """Prints one line a figure."""
    plan = make_plan(LoopbackOptions(seed=1, impairment="paper"))
    _daemons(plan)
    _loopback()
    _virtual(plan)


def _daemons(plan: Plan) -> None:
    plan = replace(
        plan,
        slave={**plan.slave, "transport": {"listen": [_ENDPOINT]}},
        master={**plan.master, "transport": {"connect": [_ENDPOINT]}},
    )
    with tempfile.TemporaryDirectory() as folder:
        slave_file, master_file = with_state(plan, Path(folder)).write(Path(folder))
        with _daemon("slave", slave_file) as slave, _daemon("master", master_file) as master:
            time.sleep(_STREAMING_S)
            for role, process in (("slave", slave), ("master", master)):
                resident_mb = _resident_mb(process.pid)
                print(f"{role}: {resident_mb:.0f} MB resident after {_STREAMING_S:g} s of streaming")


@contextmanager
def _daemon(role: str, settings: Path) -> Iterator[subprocess.Popen[str]]:
    """A daemon that has said that it is ready; the time until then is printed."""
    start_s = time.monotonic()
    command = [sys.executable, "-m", "forefeel", role, "--config", str(settings)]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    line = "nothing said"
    try:
        for line in process.stderr:
            if _READY[role] in line:
                break
        else:
            raise SystemExit(f"{role} ended: {line.strip()}")
        print(f"{role}: '{_READY[role]}' {time.monotonic() - start_s:.2f} s after its start")
        yield process
    finally:
        process.terminate()
        process.communicate()


def _loopback() -> None:
    """From the command to the open session, with the recorder."""
    taken_s = []
    for _ in range(_STARTS):
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder) / "run"
            command = f"{sys.executable} -m forefeel loopback --quiet --duration 1 --out {out}"
            start_s = time.monotonic()
            run = subprocess.Popen(command.split(), stdout=subprocess.DEVNULL)
            log = out / "master.log"
            while not (log.exists() and _READY["master"] in log.read_text(encoding="utf-8")):
                if run.poll() is not None:
                    raise SystemExit(f"loopback ended with code {run.returncode}")
                time.sleep(0.005)
            taken_s.append(time.monotonic() - start_s)
            run.wait()
    least_s, median_s, most_s = np.quantile(taken_s, [0.0, 0.5, 1.0])
    print(f"loopback: session open {median_s:.2f} s after the command ({least_s:.2f} to {most_s:.2f})")


def _resident_mb(pid: int) -> float:
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    found = re.search(r"VmRSS:\s+(\d+) kB", status)
    assert found is not None
    return int(found.group(1)) / 1024


def _virtual(plan: Plan) -> None:
    loop = VirtualLoopback(replace(plan, duration_s=_VIRTUAL_S), seed=1)
    start_s, start_cpu_s = time.monotonic(), time.process_time()
    loop.run(lambda _done_s: None)
    wall_s, cpu_s = time.monotonic() - start_s, time.process_time() - start_cpu_s
    print(f"virtual time: {_VIRTUAL_S:g} s of teleoperation in {wall_s:.1f} s ({cpu_s:.1f} s of one core)")


if __name__ == "__main__":
    print(f"{os.cpu_count()} cores, Python {sys.version.split()[0]}")
    main()
