"""`python -m tests.peers.ros_wires --python VENV/bin/python [--seconds 60]`: the table of `make ros`."""

import argparse
import json
import os
import subprocess
import sys
import time
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.live_cell import IMPORTS, LiveCell, free_port
from tests.peers.ros_wires import DOMAIN, TOPICS
from tests.peers.ros_wires.router import router
from tests.waiting import wait_until

_SETTLED_S = 8.0
"""Before the window: DDS finds its readers, who are told of a publisher when its axis is first heard."""
READERS = {"zenoh-ros2-sdk": "zenoh_reader.py", "rclpy over DDS": "rclpy_reader.py"}


def processor_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def read(folder: Path, name: str, topic: str, window_ns: tuple[int, int]) -> set[int]:
    stamps = json.loads((folder / f"{name}.json").read_text()).get(topic, [])
    return {stamp_ns for stamp_ns in stamps if window_ns[0] <= stamp_ns < window_ns[1]}


def _listens(log: Path) -> bool:
    return "listens" in log.read_text()


def measured(folder: Path, python: str, seconds: float) -> tuple[float, tuple[int, int]]:
    """Runs it all; returns the bridge's share of a core and the window in ns since 1970."""
    port, environment = free_port(), {**os.environ, "PYTHONPATH": IMPORTS}
    with ExitStack() as stack, router(port), LiveCell(folder) as cell:
        readers = []
        for name, script in READERS.items():
            words = [python, str(Path(__file__).parent / script), str(folder / f"{name}.json"), str(port)]
            path = folder / f"{name}.log"
            log = stack.enter_context(path.open("w"))
            reader = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=log, stderr=log, env=environment)
            stack.callback(reader.kill)
            readers.append(reader)
            wait_until(partial(_listens, path), what=name)
        cell.pair()
        ends = "--connect", cell.endpoint, "--connect", cell.master_endpoint
        wires = "--dds", "--zenoh", f"tcp/127.0.0.1:{port}", "--domain", str(DOMAIN)
        bridge = cell.start(
            "bridge",
            str(folder / "sent.json"),
            "ros",
            *ends,
            *wires,
            module="tests.peers.ros_wires.counted_bridge",
        )
        time.sleep(_SETTLED_S)
        before_s, start_ns = processor_s(bridge.process.pid), time.time_ns()
        time.sleep(seconds)
        share, end_ns = (processor_s(bridge.process.pid) - before_s) / seconds, time.time_ns()
        time.sleep(1.0)  # what is on the way
        bridge.interrupt()
        bridge.wait()
        for reader in readers:
            reader.communicate(b"x", timeout=30)
        print(bridge.text)
    return share, (start_ns, end_ns)


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--python", required=True)
    parser.add_argument("--seconds", type=float, default=60.0)
    asked = parser.parse_args()
    with TemporaryDirectory() as place:
        folder = Path(place)
        share, window_ns = measured(folder, asked.python, asked.seconds)
        print(*(f"{name}:\n{(folder / f'{name}.log').read_text()}" for name in READERS), sep="\n")
        print(f"| {'topic':<18} | sent  | {' | '.join(READERS)} |")
        lost = 0
        for topic in TOPICS:
            sent = read(folder, "sent", topic, window_ns)
            heard = [len(sent & read(folder, name, topic, window_ns)) for name in READERS]
            lost += (heard[0] < len(sent)) + (heard[1] < 0.99 * len(sent)) + (len(sent) < 190 * asked.seconds)
            print(
                f"| {topic:<18} | {len(sent)} | {' | '.join(f'{n} ({n / len(sent):.2%})' for n in heard)} |"
            )
    print(f"the bridge took {share:.1%} of a core, load average {os.getloadavg()[0]:.1f}")
    return int(lost > 0 or share > 0.08)


if __name__ == "__main__":
    sys.exit(main())
