"""One fault on a running service, from the start to what the recordings say of it."""

import shutil
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from forefeel.common.recording.mcap_reader import Run
from forefeel.common.topics import FORCE
from tests.system.faults import required
from tests.system.faults.logged import Expected, judge_logs
from tests.system.net.evidence import Evidence
from tests.system.net.hosts import Hosts, SmallDisk, TunCable, joined_by_tun
from tests.system.net.service import AXIS, Service
from tests.system.net.steered import Steering
from tests.system.rows import Result

SECOND = "second-record"
"""The recorder that is struck, beside one that is not."""
DISK_BYTES = 1_500_000
"""Some seconds of a recording."""
_GRACE_S = required.RAMP_S + required.SERVO_S + required.MARGIN_S


@dataclass(frozen=True, slots=True)
class Incident:
    """What was done to the service, in s of CLOCK_MONOTONIC.

    `over_s`: when the fault was over, or what had failed was started again. `stood`: the daemon that could do
    nothing until then. A master's force fades from there; of a slave, what its cell measured meanwhile is
    told with the command before. `recovery`: how it recovered, where that is not always the same. `again_s`:
    the same happened then, too.
    """

    injected_s: float
    over_s: float
    stood: str = ""
    recovery: str = ""
    again_s: tuple[float, ...] = ()


Finding = Callable[[Evidence, Incident], tuple[str, list[str]]]
"""Reads from the evidence what one row alone is about: what to say of it, and what is not as required."""


@dataclass(frozen=True, slots=True)
class Fault:
    """A row of the matrix.

    Attributes:
        act: does it while the stage moves; afterwards the service has to follow the operator again.
        route: the usual delays of its cable.
        changing: the cable becomes another one; what is old is judged within each session.
        rest_s: the stage has to be at rest by then; None: it has to go on following.
        may_go_on: it need not stop, but where it does, as required.
        faded_s: the hand feels nothing by then; None where the service goes on, or no master is left to
            show anything.
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
        """Gives the cable the delays of a route, else the usual ones, and what it does else; when."""
        ways = (route or self.route).ways
        return max(self.cable.shape(way, **settings, **more) for way, settings in ways.items()) * 1e-9

    def strike(self, name: str, number: signal.Signals) -> float:
        """Sends a signal to one of the processes; when."""
        process = self.service.processes[name]
        if number is signal.SIGKILL:
            self.hosts.expected_ends.add(process.pid)
        at_s = time.monotonic()
        process.send_signal(number)
        return at_s

    def end(self, name: str, number: signal.Signals = signal.SIGTERM) -> None:
        """Ends one of the processes, which has to say 0."""
        assert self.hosts.end(self.service.processes[name], number) == 0, self.hosts.last_words()

    def await_state(self, state: str, timeout_s: float) -> None:
        self.hosts.wait_until(lambda: self.service.state() == state, timeout_s, state)

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
            return self.service.command("clear") == 0

        self.hosts.wait_until(done, 20.0, "cleared")
        return begun_s[-1]


def tried(fault: Fault, folder: Path) -> Result:
    """Does it while the stage moves in contact on its usual cable, and judges what became of it."""
    judgement = Judgement(fault)
    try:
        with joined_by_tun(folder) as (hosts, cable), SmallDisk(folder / "disk", DISK_BYTES) as disk:
            steered = {} if fault.steered is None else dict([fault.steered])
            service = Service(hosts, steered=steered, **fault.service)
            scene = Scene(hosts, cable, service, disk, fault.route)
            scene.shape()
            if fault.on_disk:
                service.within["slave"] = disk.within
            service.start()
            service.wait_armed(30.0)
            time.sleep(1.5)
            judgement.figures.append(f"{service.wait_moving() * 1e3:.3g} mm/s before")
            incident = fault.act(scene)
            scene.rearmed()
            service.close()
            if fault.on_disk:
                ignore = shutil.ignore_patterns("*.sock")
                shutil.copytree(disk.seen / "state", folder / "state" / "slave", ignore=ignore)
        judgement.judge(incident, folder)
    except AssertionError as error:
        judgement.failures.append(str(error)[:2000])
    return Result("; ".join(judgement.figures), judgement.failures, judgement.cells)


class Judgement:
    """What was measured of a fault, and what of it is not as required."""

    def __init__(self, fault: Fault) -> None:
        self.fault = fault
        self.figures: list[str] = []
        self.failures: list[str] = []
        self._rest = "goes on" if fault.rest_s is None else f"of {fault.rest_s:.3f}"
        self._armed = ""
        self._recovery = fault.recovery

    @property
    def cells(self) -> tuple[str, ...]:
        """The row of the page of faults."""
        return self.fault.name, self._rest, self._armed, "FAILED" if self.failures else self._recovery

    def judge(self, incident: Incident, folder: Path) -> None:
        """Reads the recordings and the logs."""
        fault, at_s = self.fault, incident.injected_s
        evidence = Evidence(folder, None if fault.steered is None else (*fault.steered, at_s))
        self._judge_motion(incident, evidence)
        stood = (at_s, incident.over_s) if incident.stood == "slave" else None
        stale, excess_s = evidence.stale_commands(required.STALE_S, None if fault.changing else at_s, stood)
        self.figures.append(f"{stale} stale commands executed, the oldest {excess_s * 1e3:.3g} ms too old")
        if stale:
            self.failures.append(self.figures[-1])
        self._judge_force(incident, evidence)
        self._recovery = incident.recovery or fault.recovery
        if fault.finding is not None:
            finding, failures = fault.finding(evidence, incident)
            self._recovery = f"{self._recovery}; {finding}"
            self.failures += failures
        self.figures.append(self._recovery)
        self._judge_recordings(at_s, evidence, folder)
        logged, failures = judge_logs(folder, fault.events, fault.flights, at_s, incident.stood)
        self.figures.append(logged)
        self.failures += failures

    def _judge_motion(self, incident: Incident, evidence: Evidence) -> None:
        fault, at_s = self.fault, incident.injected_s
        moved_m = evidence.moved_while_stopped_m(_GRACE_S)
        if fault.rest_s is None:
            stop = next(
                (event for t_s, event in evidence.events if t_s > at_s and event.before == "armed"), None
            )
            if stop is not None and not fault.may_go_on and stop.event != "release":
                self.failures.append(f"the stage stopped: {stop.event}: {stop.reason}")
        else:
            moved_m = max(moved_m, self._judge_rest(fault.rest_s, incident, evidence))
        self.figures.append(f"{moved_m * 1e6:.3g} um moved while stopped")
        if moved_m > required.STILL_M:
            self.failures.append(self.figures[-1])
        engaged_s = evidence.next_event_s("engage", at_s)
        if engaged_s is not None and not evidence.released_between(at_s, engaged_s):
            self.failures.append("engaged again without a released deadman")
        over_s = evidence.next_event_s("clear", incident.over_s) or incident.over_s
        armed_s = evidence.next_event_s("engaged", over_s)
        if armed_s is not None:
            self._armed = f"{armed_s - over_s:.1f}"
        elif fault.rest_s is not None:
            self.failures.append("did not arm again")

    def _judge_rest(self, required_s: float, incident: Incident, evidence: Evidence) -> float:
        """Judges each of the stops and keeps the slowest; by how many m the stage moved on from any."""
        moved_again_m, rests_s = 0.0, list[float]()
        for at_s in (incident.injected_s, *filter(evidence.following, incident.again_s)):
            start_s = self._noticed_s(at_s, evidence)
            after_s, moved_m = evidence.rest(start_s)
            rests_s.append(after_s + start_s - at_s)
            moved_again_m = max(moved_again_m, moved_m)
            if rests_s[-1] > required_s:
                self.failures.append(f"at rest after {rests_s[-1]:.3f} s, required {required_s:.3f} s")
        self._rest = f"{max(rests_s):.3f} {self._rest}"
        self.figures.append(f"{max(rests_s):.3f} s to rest")
        return moved_again_m

    def _judge_force(self, incident: Incident, evidence: Evidence) -> None:
        fault, at_s = self.fault, incident.injected_s
        frozen = incident.stood == "master"
        stood = (at_s, incident.over_s) if frozen else None
        stale_s = 0.0 if evidence.steered else evidence.felt_stale_s(required.FORCE_AGE_S, stood)
        if stale_s > required.STALE_FELT_S:
            self.failures.append(f"the hand felt a force for {stale_s:.3f} s after the last fresh one")
        if fault.faded_s is None:
            return
        start_s = incident.over_s if frozen else self._noticed_s(at_s, evidence)
        faded_s = evidence.faded_after_s(start_s) + (0.0 if frozen else start_s - at_s)
        self.figures.append(f"{evidence.rendered_n(at_s):.3g} N faded after {faded_s:.3f} s")
        if faded_s > fault.faded_s:
            self.failures.append(f"{self.figures[-1]}, required {fault.faded_s:.2f} s")

    def _noticed_s(self, at_s: float, evidence: Evidence) -> float:
        noticed = self.fault.noticed
        return at_s if noticed is None else evidence.next_event_s(noticed, at_s) or at_s

    def _judge_recordings(self, at_s: float, evidence: Evidence, folder: Path) -> None:
        """Both have to be whole, for they were closed in order; one that was struck may have lost its end."""
        cut_off = [run.path.name for run in (evidence.slave, evidence.master) if run.truncated]
        if cut_off:
            self.failures.append(f"truncated: {', '.join(cut_off)}")
        elif self.fault.lost_s is not None:
            struck = Run(folder / f"{SECOND}.mcap")
            lost_s = max(0.0, at_s - float(struck.log_ns(AXIS, FORCE)[-1]) * 1e-9)
            self.figures.append(f"the struck recording readable, {lost_s:.1f} s lost")
            if lost_s > self.fault.lost_s:
                self.failures.append(f"{lost_s:.1f} s lost, required {self.fault.lost_s} s")
