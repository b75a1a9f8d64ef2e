"""What the commands work on, and what is always there: a slave, devices, and a machine that is busy."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from tests.live_cell import free_port
from tests.system.signals.cases import BENCH, MODEL, SLAVE
from tests.unit.diagnosis_samples import FRICTION_N, made, put

ROOT = Path(__file__).parents[3]
COMMAND = [sys.executable, "-m", "forefeel"]
_START_S = 60.0


def environment(folder: Path) -> dict[str, str]:
    """Of a command with its state in that folder."""
    return {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "XDG_STATE_HOME": str(folder),
        "PYTHONDONTWRITEBYTECODE": "",
    }


@contextmanager
def scene(folder: Path, computing: int = 0) -> Iterator[int]:
    """Makes the recordings, runs a slave and two devices; the port of the slave.

    Args:
        folder: for all of it.
        computing: processes that do nothing but compute meanwhile.
    """
    port = free_port()
    (folder / "long").mkdir()
    for name in "ab":
        put(folder / "long" / f"{name}.csv", made(60.0, friction_n=FRICTION_N, bias_n=0.05))
    (folder / "slave.yaml").write_text(SLAVE.replace("PORT", str(port)).replace("HERE", str(folder)))
    (folder / "bench.yaml").write_text(BENCH.replace("DIR", str(folder)))
    (folder / "m.yaml").write_text(MODEL)
    for line in (
        f"loopback --virtual-time --duration 10 --out {folder}/run",
        f"pki init {folder}/pki --cell one",
    ):
        subprocess.run([*COMMAND, *line.split()], env=environment(folder), check=True, capture_output=True)
    bench = f"--config {folder}/bench.yaml"
    with ExitStack() as running:
        running.enter_context(_process(folder, "slave", "--config", f"{folder}/slave.yaml"))
        for name in ("bota_serial", "zaber_ascii"):
            running.enter_context(_process(folder, *f"emulate {name} {bench}".split()))
        for _ in range(computing):
            running.enter_context(_ended(subprocess.Popen([sys.executable, "-c", "while True: pass"])))
        yield port


@contextmanager
def _process(folder: Path, *words: str) -> Iterator[None]:
    log = folder / f"{'-'.join(words[:2]).replace('/', '')}.log"
    with log.open("wb") as out:
        process = subprocess.Popen(
            [*COMMAND, *words], env=environment(folder), stdin=subprocess.DEVNULL, stdout=out, stderr=out
        )
    with _ended(process):
        end_s = time.monotonic() + _START_S
        while not log.stat().st_size:
            assert process.poll() is None and time.monotonic() < end_s, log.read_text()
            time.sleep(0.05)
        yield


@contextmanager
def _ended(process: "subprocess.Popen[bytes]") -> Iterator[None]:
    try:
        yield
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(20)
