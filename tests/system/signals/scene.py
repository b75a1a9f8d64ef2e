"""What the commands work on, and what is always there: a slave, devices, and a machine that is busy."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from tests.live_cell import IMPORTS, Process, free_port
from tests.system.signals.cases import BENCH, MODEL, SLAVE
from tests.unit.diagnosis_samples import FRICTION_N, made, put

COMMAND = [sys.executable, "-m", "forefeel"]


def environment(folder: Path) -> dict[str, str]:
    return {
        **os.environ,
        "PYTHONPATH": IMPORTS,
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
    bench = ("--config", str(folder / "bench.yaml"))
    state = {"XDG_STATE_HOME": str(folder)}
    with ExitStack() as running:
        for role, said, *words in (
            ("slave", "waiting for a master", "slave", "--config", str(folder / "slave.yaml")),
            ("cell", "baud", "emulate", "bota_serial", *bench),
            ("stage", "baud", "emulate", "zaber_ascii", *bench),
        ):
            process = Process(role, folder, *words, environment=state)
            running.callback(process.kill)
            process.wait_for(said)
        for _ in range(computing):
            busy = subprocess.Popen([sys.executable, "-c", "while True: pass"])
            running.callback(busy.wait)
            running.callback(busy.kill)
        yield port
