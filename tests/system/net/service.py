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
from pathlib import Path
from typing import Any

import yaml

from forefeel.common.state.folder import EVENTS, FLIGHT
from tests.live_cell import ROOT
from tests.secured import make_pki
from tests.system.net.hosts import ADDRESSES, MEASURING, Hosts, Process
from tests.system.net.steered import Steering

CELL, AXIS = "cathlab", "insertion"
SLAVE_AT, MASTER_AT = f"tls/{ADDRESSES[0]}:7447", f"tls/{ADDRESSES[1]}:7448"
RECORDER_AT = "tls/127.0.0.1:7450"
"""On the host itself. The slave connects to its recorder, which so hears it from its first word. The recorder
beside the master connects to it: over each of its parallel connections it would hear a part.
"""
ROUTER_AT = f"tls/{ADDRESSES[0]}:7446"
PKI = "pki"
RIVAL = "rival"
DEVICES = {"cell": "bota_serial", "stage": "zaber_ascii"}
_READY = {"slave": "waiting for a master", "router": "listening"}
BRISK = {"driver": "operator", "insert_s": 1.0, "withdraw_s": 1.0, "dwell_s": 0.05}
_TRAVEL_M = [-0.006, 0.124]
CELL_HZ = 400.0
"""Half of the usual: two hosts, their cable and their devices share what may be two cores."""
FASTEST_M_S, HARDEST_M_S2, LEAD_S = 0.4, 16.0, 0.060
"""Of the emulated stage: twice what the limits allow, so that it follows."""


class Service:
    """The processes of one cell, by name: slave, master, slave-record, master-record, stage, cell.

    `emulated`: stage and load cell are processes of their own, with the faults that SIGUSR1 brings about,
    one each time. `steered`: what SIGUSR1 does to the clock of a daemon. `through_router`: both ends know a
    router on the first host, and not each other; one recorder beside it then has all. `extra`: more settings
    by role, of which those of `axis` stand under the axis.
    """

    def __init__(
        self,
        hosts: Hosts,
        *,
        emulated: dict[str, str] | None = None,
        steered: dict[str, Steering] | None = None,
        through_router: bool = False,
        extra: dict[str, dict[str, Any]] | None = None,
    ) -> None:
        self.hosts = hosts
        self.folder = hosts.folder
        self.processes: dict[str, Process] = {}
        self.within: dict[str, tuple[str, ...]] = {}
        self._emulated, self._steered = emulated, steered or {}
        self._through_router = through_router
        self._configure(extra or {})

    def _configure(self, extra: dict[str, dict[str, Any]]) -> None:
        """Writes the files of deploy/config with the addresses of these hosts, and their certificates."""
        ends: dict[str, dict[str, Any]] = {
            "slave": {"listen": [SLAVE_AT], "connect": [RECORDER_AT]},
            "master": {"listen": [MASTER_AT, RECORDER_AT], "connect": [SLAVE_AT]},
        }
        if self._through_router:
            ends = {role: {"mode": "client", "connect": [ROUTER_AT]} for role in ends}
        changes: dict[str, dict[str, Any]] = {"slave": {}, "master": {"handle": BRISK}}
        if self._emulated is not None:
            stage, cell = (str(self.folder / name) for name in ("stage", "cell"))
            changes["slave"] = {
                "stage": {
                    "driver": "zaber_ascii", "port": stage, "microstep_m": 1e-7, "travel_m": _TRAVEL_M,
                    "max_velocity_m_s": FASTEST_M_S, "max_acceleration_m_s2": HARDEST_M_S2, "lead_s": LEAD_S,
                },
                "load_cell": {
                    "driver": "bota_serial", "port": cell, "full_scale_n": 10.0, "rate_hz": CELL_HZ,
                    "pushes_only": True, "filter_lag_s": 0.0,
                },
            }  # fmt: skip
        for role, transport in ends.items():
            settings = yaml.safe_load((ROOT / "deploy" / "config" / f"{role}.yaml").read_text())
            more = dict(extra.get(role, {}))
            settings["axes"][0] |= changes[role] | more.pop("axis", {})
            settings["transport"] = transport | {"pki": PKI}
            settings["state"] = {"directory": f"state/{role}"}
            self._write(role, settings | more)
        self._write("router", {"cells": [CELL], "transport": {"listen": [ROUTER_AT], "pki": PKI}})
        here, local = [ADDRESSES[0]], ["127.0.0.1"]
        there = [ADDRESSES[1], MEASURING[1], *local]
        names = {"slave": here, "router": here, "master": there, "recorder": local}
        make_pki(self.folder / PKI, [CELL], names)

    def _write(self, name: str, settings: dict[str, Any]) -> None:
        (self.folder / f"{name}.yaml").write_text(yaml.safe_dump(settings))

    # --- processes ---

    def start(self) -> None:
        """Starts everything, and waits until the session is open."""
        os.environ["FOREFEEL_MOTION"] = str(motion_file(self.folder))
        recorders = {"slave": ("listen", RECORDER_AT), "master": ("connect", RECORDER_AT)}
        if self._through_router:
            self.start_daemon("router")
            recorders = {"slave": ("client", ROUTER_AT)}
        for name, device in DEVICES.items() if self._emulated is not None else ():
            faults = (self._emulated or {}).get(name, "unplug,plug")
            words = ("--config", str(self.folder / "slave.yaml"), "--feel", str(self.folder / "feel"))
            self._run(name, 0, "tests.system.net.provoked", faults, device, *words, ready="baud")
        for host, (role, way) in enumerate(recorders.items()):
            line = ("tests.system.net.recorder", f"{role}.mcap", CELL, *way, PKI)
            self._run(f"{role}-record", host, *line, ready="recording")
        self.start_daemon("slave")
        self.start_daemon("master")
        self.hosts.wait_until(lambda: self.hosts.says("master.log", "session open"), 60, "a session")

    def start_daemon(self, role: str) -> None:
        """Starts slave, master or router, whose log begins anew, and waits until it listens; a master goes on
        by itself.
        """
        (self.folder / f"{role}.log").unlink(missing_ok=True)
        entry = ["forefeel"]
        if steering := self._steered.get(role):
            entry = ["tests.system.net.steered", str(steering.step_s), str(steering.rate)]
        words = (*entry, role, "--config", f"{role}.yaml")
        self._run(role, int(role == "master"), *words, ready=_READY.get(role))

    def start_rival(self) -> None:
        """Starts a second master with the same certificate, beside the first; nobody records it."""
        settings = yaml.safe_load((self.folder / "master.yaml").read_text())
        settings["transport"] |= {"listen": []}
        self._write(RIVAL, settings | {"state": {"directory": f"state/{RIVAL}"}})
        self._run(RIVAL, 1, "forefeel", "master", "--config", f"{RIVAL}.yaml")

    def start_second_recorder(self, name: str, out: str, within: tuple[str, ...] = ()) -> None:
        """Starts `forefeel record` beside the slave; `within`: what to start it with."""
        self.within[name] = within
        words = ("record", "--cell", CELL, "--connect", SLAVE_AT, "--pki", PKI, "--out", out)
        self._run(name, 0, "forefeel", *words)

    def _run(self, name: str, host: int, *words: str, ready: str | None = None) -> None:
        """Starts a process and waits until its log says `ready`."""
        log = f"{name}.log"
        self.processes[name] = self.hosts.run(host, log, *words, within=self.within.get(name, ()))
        if ready is not None:
            patience_s = 60.0 if name == "slave" else 20.0
            self.hosts.wait_until(lambda: self.hosts.says(log, ready), patience_s, name)

    def command(self, name: str, timeout_s: float = 20.0) -> int:
        """Runs `forefeel NAME` with the slave's settings on its host; its exit code."""
        words = ("forefeel", name, "--config", "slave.yaml")
        process = self.hosts.run(0, f"{name}.log", *words, within=self.within.get("slave", ()))
        self.hosts.expected_ends.add(process.pid)
        try:
            return process.wait(timeout_s)
        except subprocess.TimeoutExpired as error:
            raise AssertionError(f"forefeel {name} did not come back in {timeout_s:g} s") from error

    # --- what is seen ---

    def newest(self) -> dict[str, Any]:
        """The newest state of the slave that its recorder has shown, `silent` before any."""
        path = self.folder / "slave-record.log"
        with path.open("rb") as file:
            file.seek(max(0, path.stat().st_size - 1000))
            lines = [line for line in file.read().splitlines(keepends=True) if line.endswith(b"}\n")]
        shown: dict[str, Any] = {"state": "silent", "at_s": 0.0}
        return shown | json.loads(lines[-1]) if lines and lines[-1].startswith(b"{") else shown

    def state(self) -> str:
        """The slave's state, `silent` when nothing was heard for half a second."""
        newest = self.newest()
        return str(newest["state"]) if time.monotonic() - newest["at_s"] <= 0.5 else "silent"

    def wait_armed(self, timeout_s: float = 20.0) -> None:
        self.hosts.wait_until(lambda: self.state() == "armed", timeout_s, f"armed, but {self.newest()}")

    def wait_moving(self, speed_m_s: float = 0.02, deep_m: float = 0.012) -> float:
        """Waits until the stage moves fast and has contact; its speed then."""
        self.wait_armed()
        speeds_m_s: list[float] = []

        def moving() -> bool:
            newest = self.newest()
            if newest["state"] != "armed" or newest["position_m"] < deep_m:
                return False
            speeds_m_s.append(abs(newest["velocity_m_s"]))
            return speeds_m_s[-1] > speed_m_s and bool(time.monotonic() - newest["at_s"] < 0.04)

        self.hosts.wait_until(moving, 20.0, "moving")
        return speeds_m_s[-1]

    def close(self) -> None:
        """Ends what still runs in order, recorders last, so that the recordings are whole."""
        for name in ("master", "slave", "slave-record", "master-record", "router", *DEVICES):
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
