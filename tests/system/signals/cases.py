"""Every command, how long a signal may find it at work, and with which codes it may end."""

from dataclasses import dataclass

SLAVE = """role: slave
transport: {listen: ["tcp/127.0.0.1:PORT"]}
state: {directory: HERE/state}
"""
MASTER = """role: master
transport: {connect: ["tcp/127.0.0.1:CELL"]}
state: {directory: HERE/state}
"""
ROUTER = """role: router
cells: [one, two]
transport: {listen: ["tcp/127.0.0.1:PORT"]}
"""
MODEL = """schema: forefeel.model/1
name: a guess
effects:
  - effect: mass_damper_spring
    parameters: {mass_kg: 0.02, damping_n_s_m: 0.8, stiffness_n_m: 40.0}
"""
BENCH = """role: slave
axes:
- stage: {driver: zaber_ascii, port: DIR/stage, microstep_m: 1.0e-7, travel_m: [0, 0.09]}
  load_cell: {driver: bota_serial, port: DIR/cell, full_scale_n: 10, rate_hz: 200, serial: B-7,
    pushes_only: true, filter_lag_s: 0}
  gripper: {driver: simulated}
  limits: {workspace_m: [0, 0.08]}
state: {directory: DIR/bench-state}
"""


@dataclass(frozen=True)
class Case:
    """One command.

    `line` and `files`: HERE is the folder of the run, READY that of what was made before, CELL the port of a
    slave that runs all the time, PORT a free one. `ends`: the code of a command that was told to end when it
    was at work. `within_s`: the signal comes by then, from when it is at work (`LOOKS`: from its start).
    """

    name: str
    line: str
    ends: tuple[int, ...]
    within_s: float = 6.0
    files: tuple[tuple[str, str], ...] = ()

    @property
    def shares(self) -> bool:
        """Whether it takes devices or writes files that others use, too: one at a time."""
        return "READY/bench" in self.line or "READY/pki" in self.line


RESULTS, SERVES, LOOKS = (0, 1), (0,), (1, 0)
"""Codes: what makes results may be done before the signal, else it was interrupted, in one line; what serves
ends well; what looks around or acts at once may find something wrong, and say so in its own way.
"""
AT_SLAVE = "--cell cell --connect tcp/127.0.0.1:CELL"
ON_BENCH = "--config READY/bench.yaml --axis insertion --yes"
CASES = (
    Case("slave", "slave --config HERE/slave.yaml", SERVES, 3.0, (("slave.yaml", SLAVE),)),
    Case("master", "master --config HERE/master.yaml", (0, 1, 2), 4.0, (("master.yaml", MASTER),)),
    Case("router", "router --config HERE/router.yaml --insecure", SERVES, 2.0, (("router.yaml", ROUTER),)),
    Case("loopback", "loopback --duration 60 --out HERE/out", RESULTS, 8.0),
    Case("devices looped", "loopback --duration 60 --hardware emulated-serial --out HERE/out", RESULTS, 10.0),
    Case("loopback in virtual time", "loopback --virtual-time --duration 300 --out HERE/out", RESULTS, 6.0),
    Case("record", f"record {AT_SLAVE} --out HERE/run.mcap", (0, 1), 3.0),
    Case("metrics", f"metrics {AT_SLAVE} --port PORT", SERVES, 2.0),
    Case("dashboard", f"dashboard {AT_SLAVE} --port PORT", SERVES, 4.0),
    Case("view", "view READY/run/recording.mcap --port PORT", SERVES, 4.0),
    Case("simulate", "simulate --model READY/m.yaml --duration 600 --out HERE/s.csv", RESULTS, 6.0),
    Case("diagnose a file", "diagnose READY/long/a.csv --out HERE/out", RESULTS, 10.0),
    Case("diagnose a folder", "diagnose READY/long --jobs 2 --out HERE/out", RESULTS, 12.0),
    Case("evaluate", "evaluate READY/long/a.csv READY/long/b.csv --out HERE/out", RESULTS, 5.0),
    Case("report", "report READY/run/recording.mcap --out HERE/out", RESULTS, 5.0),
    Case("pki init", "pki init HERE/pki --cell one --cell two --cell three", RESULTS, 0.5),
    Case("doctor", "doctor", LOOKS, 6.0),
    Case("devices", "devices", LOOKS, 2.5),
    Case("device probe", "device probe --config READY/bench.yaml --seconds 30", RESULTS, 3.0),
    Case("calibrate load-cell", f"calibrate load-cell {ON_BENCH} --forces 1 --out HERE/c.yaml", RESULTS, 4.0),
    Case("calibrate stage", f"calibrate stage {ON_BENCH} --velocity 0.01 --out HERE/c.yaml", RESULTS, 5.0),
    Case("emulate zaber_ascii", "emulate zaber_ascii --port HERE/port", SERVES, 2.0),
    Case("emulate can_hub", "emulate can_hub --port HERE/a,HERE/b", SERVES, 2.0),
    Case("estop", f"estop {AT_SLAVE}", LOOKS, 3.0),
    Case("clear", "clear --config READY/slave.yaml", LOOKS, 2.5),
    Case("config check", "config check READY/slave.yaml", LOOKS, 2.5),
)  # fmt: skip
