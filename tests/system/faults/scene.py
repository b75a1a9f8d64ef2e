"""One fault on a running service, from the start to what the recordings say of it."""

import json
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from forefeel.common.recording.mcap_reader import Run
from forefeel.common.topics import FORCE
from tests.system.faults import required
from tests.system.faults.logged import Expected, logged
from tests.system.net.cable import TunCable
from tests.system.net.disk import SmallDisk
from tests.system.net.evidence import Evidence
from tests.system.net.hosts import Hosts, joined_by_tun
from tests.system.net.service import AXIS, Service
from tests.system.net.steered import Steering

SECOND = "second-record"
"""The recorder that is struck, beside one that is not."""
DISK_BYTES = 1_500_000
"""Some seconds of a recording."""


@dataclass(frozen=True, slots=True)
class Incident:
    """What was done to the service, in s of CLOCK_MONOTONIC.

    `over_s`: when the fault was over, or what had failed was started again. `frozen`: until then the master
    could show nothing, so its force fades from there. `stood`: until then the slave could execute nothing;
    what its cell measured meanwhile is told with the command before. `gone`: the master was killed, and
    shows nothing. `recovery`: how it recovered, where that is not always the same. `again_s`: the same
    happened then, too.
    """

    injected_s: float
    over_s: float
    speed_m_s: float
    frozen: bool = False
    stood: bool = False
    gone: bool = False
    recovery: str = ""
    again_s: tuple[float, ...] = ()


Finding = Callable[[Evidence, Incident], tuple[str, list[str]]]
"""Reads from the evidence what one row alone is about: what to say of it, and what is not as required."""


@dataclass(frozen=True, slots=True)
class Fault:
    """A row of the matrix.

    Attributes:
        act: does it, and waits until the service has recovered where it can.
        route: the usual delays of its cable.
        changing: the cable becomes another one; what is old is judged within each session.
        rest_s: the stage has to be at rest by then; None: it has to go on following.
        may_go_on: it need not stop, but where it does, as required.
        faded_s: the hand feels nothing by then; None where the service goes on.
        recovery: in words.
        service: keyword arguments of `Service`.
        steered: the daemon whose clock is made wrong, and how.
        noticed: the event by which the slave notices it, to be measured from there where it goes on until
            then, which `rest_s` and `faded_s` have in them.
        on_disk: the slave's state folder is on the small disk.
        lost_s: the second recorder is struck: its recording has to be readable, and lose no more than that.
        events: those that have to be in the event logs.
        flights: the daemons of whom a flight record is due.
        finding: what else is read from the evidence.
    """

    name: str
    act: Callable[["Scene"], Incident]
    recovery: str
    route: required.Route = required.NEAR
    changing: bool = False
    rest_s: float | None = None
    may_go_on: bool = False
    faded_s: float | None = None
    service: dict[str, Any] = field(default_factory=dict)
    steered: tuple[str, Steering] | None = None
    noticed: str | None = None
    on_disk: bool = False
    lost_s: float | None = None
    events: tuple[Expected, ...] = ()
    flights: tuple[str, ...] = ()
    finding: Finding | None = None


@dataclass(frozen=True, slots=True)
class Scene:
    """What a fault can get hold of. `route`: the usual delays of the cable."""

    hosts: Hosts
    cable: TunCable
    service: Service
    disk: SmallDisk
    route: required.Route

    def shape(self, route: required.Route | None = None, /, **more: Any) -> float:  # noqa: ANN401
        """The delays of a route, else the usual ones, and what else the cable does both ways; when."""
        ways = (route or self.route).ways
        return max(self.cable.shape(way, **settings, **more) for way, settings in ways.items()) * 1e-9

    def strike(self, name: str, number: signal.Signals) -> float:
        """A signal to one of the processes; when."""
        process = self.service.processes[name]
        if number is signal.SIGKILL:
            self.hosts.expected_ends.add(process.pid)
        at_s = time.monotonic()
        process.send_signal(number)
        return at_s

    def said(self, role: str, text: str) -> int:
        """How often a daemon has said that."""
        return (self.hosts.folder / f"{role}.log").read_text(errors="replace").count(text)

    def rearmed(self) -> None:
        """Waits until the service follows the operator again, and a second longer."""
        self.service.wait_armed(25.0)
        time.sleep(1.0)

    def cleared(self) -> float:
        """Clears what is latched, as soon as it can be; when that was begun: the service follows again
        before the command has ended.
        """
        begun_s = [0.0]

        def done() -> bool:
            begun_s.append(time.monotonic())
            return self.service.clear() == 0

        self.hosts.wait_until(done, 20.0, "cleared")
        return begun_s[-1]


@dataclass(slots=True)
class Row:
    """What was measured, and what of it is not as required."""

    name: str
    recovery: str
    asked_s: float | None
    rest_s: float | None = None
    speed_m_s: float = 0.0
    stale: int | None = None
    excess_s: float | None = None
    faded_s: float | None = None
    force_n: float = 0.0
    moved_again_m: float | None = None
    armed_s: float | None = None
    recording: str = ""
    logged: str = ""
    failures: list[str] = field(default_factory=list)


@contextmanager
def staged(folder: Path, fault: Fault) -> Iterator[Scene]:
    """The service, armed for a second on its usual cable."""
    with joined_by_tun(folder) as (hosts, cable), SmallDisk(folder / "disk", DISK_BYTES) as disk:
        steered = {} if fault.steered is None else dict([fault.steered])
        service = Service(hosts, steered=steered, **fault.service)
        scene = Scene(hosts, cable, service, disk, fault.route)
        scene.shape()
        if fault.on_disk:
            scene.service.within["slave"] = disk.within
        scene.service.start()
        scene.service.wait_armed(30.0)
        time.sleep(1.5)
        yield scene


def tried(fault: Fault, folder: Path) -> Row:
    """Runs one fault and judges it."""
    row = Row(fault.name, fault.recovery, fault.rest_s)
    try:
        with staged(folder, fault) as scene:
            incident = fault.act(scene)
            scene.service.close()
            if fault.on_disk:
                ignore = shutil.ignore_patterns("*.sock")
                shutil.copytree(scene.disk.seen / "state", folder / "state" / "slave", ignore=ignore)
            judge(row, fault, incident, folder)
    except AssertionError as error:
        row.failures.append(str(error)[:2000])
    (folder / "row.json").write_text(json.dumps({"name": row.name, "failures": row.failures}))
    return row


def judge(row: Row, fault: Fault, incident: Incident, folder: Path) -> None:
    """Fills the row from the recordings."""
    at_s, row.speed_m_s = incident.injected_s, incident.speed_m_s
    found = Evidence(folder, None if fault.steered is None else (*fault.steered, at_s))
    _judge_motion(row, fault, incident, found)
    stood = (at_s, incident.over_s) if incident.stood else None
    row.stale, row.excess_s = found.stale_commands(required.STALE_S, None if fault.changing else at_s, stood)
    if row.stale:
        row.failures.append(f"{row.stale} stale commands executed, {row.excess_s * 1e3:.0f} ms too old")
    _judge_force(row, fault, incident, found)
    row.recording = _recordings(row, found, at_s, folder / f"{SECOND}.mcap", fault.lost_s)
    _judge_log(row, fault, incident, found, folder)
    if fault.finding is not None:
        said, failures = fault.finding(found, incident)
        row.recovery = f"{row.recovery}; {said}"
        row.failures += failures


def _judge_force(row: Row, fault: Fault, incident: Incident, found: Evidence) -> None:
    frozen = (incident.injected_s, incident.over_s) if incident.frozen else None
    stale_s = 0.0 if found.steered else found.felt_stale_s(required.FORCE_AGE_S, frozen)
    if stale_s > required.STALE_FELT_S:
        row.failures.append(f"the hand felt a force for {stale_s:.3f} s after the last fresh one")
    if fault.faded_s is None or incident.gone:
        return
    at_s = incident.injected_s
    row.force_n = found.rendered_n(at_s)
    start_s = incident.over_s if incident.frozen else _noticed_s(fault, at_s, found)
    row.faded_s = found.faded_after_s(start_s)
    if row.faded_s is not None and not incident.frozen:
        row.faded_s += start_s - at_s
    if row.faded_s is None or row.faded_s > fault.faded_s:
        row.failures.append(f"force faded after {row.faded_s} s, required {fault.faded_s:.2f} s")


def _judge_motion(row: Row, fault: Fault, incident: Incident, found: Evidence) -> None:
    at_s, grace_s = incident.injected_s, required.RAMP_S + required.SERVO_S + required.MARGIN_S
    engaged_s = found.next_event_s("engage", at_s)
    if fault.rest_s is None:
        stop = next(
            (event for time_s, event in found.events if time_s > at_s and event.before == "armed"), None
        )
        if stop is not None and not fault.may_go_on and stop.event != "release":
            row.failures.append(f"the stage stopped: {stop.event}: {stop.reason}")
        row.moved_again_m = found.moved_while_stopped_m(grace_s)
    else:
        _judge_rest(row, fault, incident, found)
        row.moved_again_m = max(row.moved_again_m or 0.0, found.moved_while_stopped_m(grace_s))
    if row.moved_again_m > required.STILL_M:
        row.failures.append(f"moved by {row.moved_again_m * 1e3:.3f} mm while stopped")
    if engaged_s is not None and not found.released_between(at_s, engaged_s):
        row.failures.append("engaged again without a released deadman")
    over_s = found.next_event_s("clear", incident.over_s) or incident.over_s
    armed_s = found.next_event_s("engaged", over_s)
    row.armed_s = None if armed_s is None else armed_s - over_s
    if fault.rest_s is not None and armed_s is None:
        row.failures.append("did not arm again")


def _judge_rest(row: Row, fault: Fault, incident: Incident, found: Evidence) -> None:
    """The slowest of the stops, where there were several."""
    assert fault.rest_s is not None
    for at_s in (incident.injected_s, *filter(found.following, incident.again_s)):
        start_s = _noticed_s(fault, at_s, found)
        rest = found.rest(start_s)
        rest_s = None if rest.after_s is None else rest.after_s + start_s - at_s
        row.moved_again_m = max(row.moved_again_m or 0.0, rest.moved_again_m)
        if rest_s is None or rest_s > fault.rest_s:
            row.failures.append(f"at rest after {rest_s} s, required {fault.rest_s:.3f} s")
        row.rest_s = rest_s if row.rest_s is None or rest_s is None else max(row.rest_s, rest_s)


def _noticed_s(fault: Fault, at_s: float, found: Evidence) -> float:
    return at_s if fault.noticed is None else found.next_event_s(fault.noticed, at_s) or at_s


def _judge_log(row: Row, fault: Fault, incident: Incident, found: Evidence, folder: Path) -> None:
    stood = {role for role, still in (("master", incident.frozen), ("slave", incident.stood)) if still}
    kept = logged(folder, fault.events, fault.flights, incident.injected_s, stood)
    row.logged, row.recovery = str(kept), incident.recovery or fault.recovery
    row.failures += kept.failures


def _recordings(row: Row, found: Evidence, at_s: float, struck: Path, bound_s: float | None) -> str:
    """Whether both are whole, for they were closed in order; what a recorder left that was struck."""
    cut_off = [run.path.name for run in (found.slave, found.master) if run.truncated]
    if cut_off:
        row.failures.append(f"truncated: {', '.join(cut_off)}")
        return "truncated"
    if bound_s is None:
        return "whole"
    run = Run(struck)
    lost_s = max(0.0, at_s - float(run.log_ns(AXIS, FORCE)[-1]) * 1e-9)
    if lost_s > bound_s:
        row.failures.append(f"{lost_s:.1f} s lost, required {bound_s} s")
    return f"whole; the struck one readable, {lost_s:.1f} s lost"
