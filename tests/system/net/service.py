"""The service on two hosts: slave and its recorder on the first, master and its recorder on the second.

With certificates and access control, as delivered. Each recorder hears the daemon on its own host, so that a
fault of the cable is recorded from both sides. All stamps are of one CLOCK_MONOTONIC: network namespaces
share it.
"""

import json
import os
import shutil
import subprocess
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import yaml

from forefeel.common.state.folder import EVENTS, FLIGHT
from tests.secured import make_pki
from tests.system.net.cable import ADDRESSES, MEASURING, ROOT
from tests.system.net.hosts import Hosts, Process
from tests.system.net.steered import Steering

DEPLOY = ROOT / "deploy" / "config"
CELL, AXIS = "cathlab", "insertion"
SLAVE_AT, MASTER_AT = f"tls/{ADDRESSES[0]}:7447", f"tls/{ADDRESSES[1]}:7448"
RECORDER_AT, OBSERVER_AT = "tls/127.0.0.1:7450", "tls/127.0.0.1:7451"
"""On the host itself. The slave connects to those who look on, which so hear it from its first word. The
recorder beside the master connects to it: over each of its parallel connections it would hear a part.
"""
ROUTER_AT = f"tls/{ADDRESSES[0]}:7446"
PKI = "pki"
RIVAL = "rival"
DEVICES = {"cell": "bota_serial", "stage": "zaber_ascii"}
BRISK = {"driver": "operator", "insert_s": 1.0, "withdraw_s": 1.0, "dwell_s": 0.05}
_TRAVEL_M = [-0.006, 0.124]
CELL_HZ = 400.0
"""Half of the usual: two hosts, their cable and their devices share what may be two cores."""
FASTEST_M_S, HARDEST_M_S2, LEAD_S = 0.4, 16.0, 0.060
"""Of the emulated stage: twice what the limits allow, so that it follows."""


def configure(
    folder: Path,
    axis: dict[str, dict[str, Any]] | None = None,
    emulated: bool = False,
    through_router: bool = False,
    extra: dict[str, dict[str, Any]] | None = None,
) -> None:
    """The files of deploy/config with the addresses of these hosts, and their certificates; see `Service`."""
    here = {
        "slave": [ADDRESSES[0]],
        "router": [ADDRESSES[0]],
        "master": [ADDRESSES[1], MEASURING[1], "127.0.0.1"],
    }
    make_pki(folder / PKI, [CELL], {**here, "recorder": ["127.0.0.1"], "viewer": ["127.0.0.1"]})
    slave = yaml.safe_load((DEPLOY / "slave.yaml").read_text())
    master = yaml.safe_load((DEPLOY / "master.yaml").read_text())
    ends: dict[str, dict[str, Any]] = {
        "slave": {"listen": [SLAVE_AT], "connect": [RECORDER_AT, OBSERVER_AT]},
        "master": {"listen": [MASTER_AT, RECORDER_AT], "connect": [SLAVE_AT]},
    }
    if through_router:
        ends = {role: {"mode": "client", "connect": [ROUTER_AT]} for role in ends}
    if emulated:
        slave["axes"][0]["stage"] = {
            "driver": "zaber_ascii", "port": str(folder / "stage"), "microstep_m": 1e-7,
            "travel_m": _TRAVEL_M, "max_velocity_m_s": FASTEST_M_S,
            "max_acceleration_m_s2": HARDEST_M_S2, "lead_s": LEAD_S,
        }  # fmt: skip
        slave["axes"][0]["load_cell"] = {
            "driver": "bota_serial", "port": str(folder / "cell"), "full_scale_n": 10.0, "rate_hz": CELL_HZ,
            "pushes_only": True,
            "filter_lag_s": 0.0,
        }  # fmt: skip
    for role, own in (("slave", slave), ("master", master)):
        own["axes"][0] |= (axis or {}).get(role, {})
        own["transport"] = {"pki": PKI, **ends[role]}
        whole = own | {"state": {"directory": f"state/{role}"}} | (extra or {}).get(role, {})
        (folder / f"{role}.yaml").write_text(yaml.safe_dump(whole))


class Service:
    """The processes of one cell, by name: slave, master, slave-record, master-record, observer, stage, cell.

    `emulated`: stage and load cell are processes of their own, with the faults that SIGUSR1 brings about,
    one each time. `steered`: what SIGUSR1 does to the clock of a daemon. `axis`: what else
    stands under the axis, by role; `extra`: at the top. `through_router`: both ends know a router on the
    first host, and not each other; then who looks on hears through it, too, and one recorder beside it has
    all. `insecure`: for settings that are written over those of `configure`, without certificates.
    """

    def __init__(
        self,
        hosts: Hosts,
        *,
        emulated: dict[str, str] | None = None,
        steered: dict[str, Steering] | None = None,
        axis: dict[str, dict[str, Any]] | None = None,
        through_router: bool = False,
        extra: dict[str, dict[str, Any]] | None = None,
        insecure: bool = False,
    ) -> None:
        self.hosts = hosts
        self.folder = hosts.folder
        self.processes: dict[str, Process] = {}
        self.within: dict[str, tuple[str, ...]] = {}
        self._emulated, self._steered = emulated, steered or {}
        self._through_router = through_router
        self._consent = ("--insecure",) if insecure else ()
        configure(
            self.folder,
            {"master": {"handle": BRISK}} | (axis or {}),
            emulated is not None,
            through_router,
            extra,
        )

    # --- processes ---

    def start(self) -> None:
        """Everything, until the session is open."""
        os.environ["FOREFEEL_MOTION"] = str(self.folder / "motion.bin")
        if self._through_router:
            self.start_router()
        if self._emulated is not None:
            self.start_devices()
        for role in ("slave",) if self._through_router else ("slave", "master"):
            self.start_recorder(role)
        self.start_observer()
        self.start_slave()
        self.start_master()
        self.hosts.wait_until(lambda: self.hosts.says("master.log", "session open"), 60, "a session")

    def start_router(self) -> None:
        settings = {"cells": [CELL], "transport": {"listen": [ROUTER_AT], "pki": PKI}}
        path = self.folder / "router.yaml"
        path.write_text(yaml.safe_dump(settings))
        self.processes["router"] = self.hosts.run(
            0, "router.log", "forefeel", "router", "--config", str(path)
        )
        self.hosts.wait_until(lambda: self.hosts.says("router.log", "listening"), 20, "the router")

    def start_devices(self) -> None:
        for name in DEVICES:
            self.start_device(name)

    def start_device(self, name: str) -> None:
        assert self._emulated is not None
        faults = self._emulated.get(name, "unplug,plug")
        config = ("--config", str(self.folder / "slave.yaml"))
        feel = ("--feel", str(self.folder / "feel"))
        (self.folder / f"{name}.log").unlink(missing_ok=True)
        words = ("tests.system.net.provoked", faults, DEVICES[name], *config, *feel)
        self.processes[name] = self.hosts.run(0, f"{name}.log", *words)
        self.hosts.wait_until(lambda: self.hosts.says(f"{name}.log", "baud"), 20, name)

    def start_slave(self) -> None:
        (self.folder / "slave.log").unlink(missing_ok=True)
        self.processes["slave"] = self._daemon(0, "slave")
        self.hosts.wait_until(lambda: self.hosts.says("slave.log", "waiting for a master"), 60, "the slave")

    def start_master(self) -> None:
        self.processes["master"] = self._daemon(1, "master")

    def start_rival(self) -> None:
        """A second master with the same certificate, beside the first; nobody records it."""
        settings = yaml.safe_load((self.folder / "master.yaml").read_text())
        settings["transport"] |= {"listen": []}
        settings["state"] = {"directory": f"state/{RIVAL}"}
        (self.folder / f"{RIVAL}.yaml").write_text(yaml.safe_dump(settings))
        words = ("forefeel", "master", "--config", f"{RIVAL}.yaml", *self._consent)
        self.processes[RIVAL] = self.hosts.run(1, f"{RIVAL}.log", *words)

    def start_recorder(self, role: str) -> None:
        host = ("slave", "master").index(role)
        way = ("connect", RECORDER_AT) if role == "master" else self._way(RECORDER_AT)
        words = ("tests.system.net.recorder", f"{role}.mcap", CELL, *way, PKI)
        name = f"{role}-record"
        self.processes[name] = self.hosts.run(host, f"{name}.log", *words)
        self.hosts.wait_until(lambda: self.hosts.says(f"{name}.log", "recording"), 20, name)

    def start_second_recorder(self, name: str, out: str, within: tuple[str, ...] = ()) -> None:
        """`forefeel record` beside the slave; `within`: what to start it with."""
        at = ROUTER_AT if self._through_router else SLAVE_AT
        words = ("forefeel", "record", "--cell", CELL, "--connect", at, "--pki", PKI, "--out", out)
        self.processes[name] = self.hosts.run(0, f"{name}.log", *words, within=within)

    def start_observer(self) -> None:
        words = ("tests.system.net.observer", CELL, AXIS, *self._way(OBSERVER_AT), PKI)
        self.processes["observer"] = self.hosts.run(0, "seen.log", *words)

    def _way(self, endpoint: str) -> tuple[str, str]:
        """How who looks on is connected: the slave comes to it, or both to the router."""
        return ("client", ROUTER_AT) if self._through_router else ("listen", endpoint)

    def clear(self) -> int:
        """`forefeel clear` on the slave's host; its exit code."""
        return self._beside_the_slave("clear")

    def stop(self) -> int:
        """`forefeel estop` on the slave's host; its exit code."""
        return self._beside_the_slave("estop")

    def _beside_the_slave(self, command: str) -> int:
        words = ("forefeel", command, "--config", "slave.yaml")
        process = self.hosts.run(0, f"{command}.log", *words, within=self.within.get("slave", ()))
        self.hosts.expected_ends.add(process.pid)
        with suppress(subprocess.TimeoutExpired):
            return process.wait(20)
        raise AssertionError(f"forefeel {command} did not come back in 20 s")

    def _daemon(self, host: int, role: str) -> Process:
        steering = self._steered.get(role)
        entry = ("forefeel",) if steering is None else ("tests.system.net.steered", *steering.words)
        words = (*entry, role, "--config", f"{role}.yaml", *self._consent)
        return self.hosts.run(host, f"{role}.log", *words, within=self.within.get(role, ()))

    # --- what is seen ---

    def seen(self) -> dict[str, Any] | None:
        """The newest state of the slave that the observer has heard, None before any."""
        path = self.folder / "seen.log"
        if not path.exists():
            return None
        with path.open("rb") as file:
            file.seek(max(0, path.stat().st_size - 1000))
            lines = [line for line in file.read().splitlines(keepends=True) if line.endswith(b"}\n")]
        found = json.loads(lines[-1]) if lines and lines[-1].startswith(b"{") else None
        assert found is None or isinstance(found, dict)
        return found

    def state(self) -> str:
        """The slave's state, `silent` when nothing was heard for half a second."""
        seen = self.seen()
        if seen is None or time.monotonic() - seen["at_s"] > 0.5:
            return "silent"
        return str(seen["state"])

    def wait_armed(self, timeout_s: float = 20.0) -> None:
        self.hosts.wait_until(lambda: self.state() == "armed", timeout_s, f"armed, but {self.seen()}")

    def wait_moving(self, speed_m_s: float = 0.02, deep_m: float = 0.012) -> float:
        """Until the stage moves fast and has contact; its speed then."""
        self.wait_armed()
        last: list[float] = []

        def moving() -> bool:
            seen = self.seen()
            fast = seen is not None and abs(seen["velocity_m_s"]) > speed_m_s
            if seen is None or not fast or seen["state"] != "armed" or seen["position_m"] < deep_m:
                return False
            last.append(abs(seen["velocity_m_s"]))
            return bool(time.monotonic() - seen["at_s"] < 0.04)

        self.hosts.wait_until(moving, 20.0, "moving")
        return last[-1]

    def close(self) -> None:
        """Ends what still runs in order, recorders last, so that the recordings are whole."""
        for name in (
            "master",
            "slave",
            "slave-record",
            "master-record",
            "observer",
            "router",
            "cell",
            "stage",
        ):
            process = self.processes.get(name)
            if process is not None and process.poll() is None:
                self.hosts.end(process)
        if self._through_router:
            shutil.copy(self.folder / "slave.mcap", self.folder / "master.mcap")


def event_file(folder: Path, role: str) -> Path:
    return folder / "state" / role / EVENTS


def flight_files(folder: Path, role: str) -> list[Path]:
    """The flight records of a daemon, the oldest first."""
    return sorted((folder / "state" / role / FLIGHT).glob("*.mcap"))


def motion_file(folder: Path) -> Path:
    """What the emulated stage really did."""
    return folder / "motion.bin"
