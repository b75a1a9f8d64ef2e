"""The faults: each is done while the stage moves; afterwards the service has to follow the operator again."""

import resource
import signal
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from functools import partial
from typing import Any

import yaml

from forefeel.common.clock import now_utc
from tests.system.faults import required as r
from tests.system.faults.logged import Expected, heard, stopped
from tests.system.faults.required import Route
from tests.system.faults.scene import SECOND, Fault, Incident, Scene
from tests.system.net.evidence import Evidence
from tests.system.net.hosts import ip
from tests.system.net.service import RIVAL, SLAVE_AT
from tests.system.net.steered import Steering

_FAULT_S = 2.0
_NS = 1e-9
EMULATED: dict[str, Any] = {"emulated": {}}
_HELD = "another session holds the lease"
_NO_ANSWER = "accepts the connection and says nothing"
_SMALL_BYTES = 576
"""What every host of the Internet takes; TCP sends up to 1500 where nobody tells it of less."""


def _killed(role: str, scene: Scene) -> Incident:
    """SIGKILL; started again after 2 s."""
    at_s = scene.strike(role, signal.SIGKILL)
    time.sleep(_FAULT_S)
    return _started(role, at_s, scene)


def _restarted(role: str, scene: Scene, number: signal.Signals = signal.SIGTERM) -> Incident:
    """SIGTERM, as a service manager does, or SIGHUP, as a terminal that goes; a new process and session."""
    at_s = time.monotonic()
    scene.end(role, number)
    return _started(role, at_s, scene)


def _started(role: str, at_s: float, scene: Scene) -> Incident:
    """Starts what has ended since `at_s`."""
    over_s = time.monotonic()
    scene.service.start_daemon(role)
    return Incident(at_s, over_s)


def _frozen(role: str, frozen_s: float, scene: Scene) -> Incident:
    """SIGSTOP, and SIGCONT."""
    at_s = scene.strike(role, signal.SIGSTOP)
    time.sleep(frozen_s)
    over_s = scene.strike(role, signal.SIGCONT)
    time.sleep(0.5)
    return Incident(at_s, over_s, stood=role)


def _cut(cut_s: float, times: int, scene: Scene) -> Incident:
    """All packets are lost for that long, once every two seconds."""
    begun_s, over_s = list[float](), 0.0
    while len(begun_s) < times:
        begun_s.append(scene.cable.cut() * _NS)
        time.sleep(cut_s)
        over_s = scene.cable.mend() * _NS
        time.sleep(_FAULT_S - cut_s)
    return Incident(begun_s[0], over_s, again_s=tuple(begun_s[1:]))


def _stalled(stall_s: float, scene: Scene) -> Incident:
    """Everything is held, then comes in one burst: old commands to the slave, old forces to the master."""
    at_s = scene.cable.stall(stall_s) * _NS
    time.sleep(stall_s + 0.5)
    return Incident(at_s, at_s + stall_s)


def shaped(duration_s: float, scene: Scene, route: r.Route | None = None, **more: Any) -> Incident:  # noqa: ANN401
    """The cable does that for a while, or only those or its usual delays; what runs above retransmits."""
    at_s = scene.shape(route, **more)
    time.sleep(duration_s)
    return Incident(at_s, scene.shape())


def _small_packets_at_start(scene: Scene) -> Incident:
    """The handshake of TLS does not pass. The cable stays so; the MTU of one host's device is the cure, which
    bounds the segments of both.
    """
    at_s = time.monotonic()
    scene.end("master")
    scene.shape(largest_bytes=_SMALL_BYTES)
    scene.service.start_daemon("master")
    scene.hosts.wait_until(lambda: scene.hosts.says("master.log", _NO_ANSWER), 20.0, _NO_ANSWER)
    assert scene.service.state() == "idle", scene.service.newest()
    master = scene.hosts.names[1]
    ip("-n", master, "link", "set", master, "mtu", str(_SMALL_BYTES))
    return Incident(at_s, time.monotonic())


def _jumped(scene: Scene) -> Incident:
    """The way becomes longer for some seconds, but less than where the slave would not arm."""
    at_s = scene.shape(r.SLOW)
    time.sleep(1.0)
    scene.rearmed()
    time.sleep(2.0)
    scene.shape()
    time.sleep(1.0)
    return Incident(at_s, at_s)


def _half_open(scene: Scene) -> Incident:
    """The master dies while the cable is cut; its connections never end for the slave."""
    at_s = scene.cable.cut() * _NS
    scene.strike("master", signal.SIGKILL)
    scene.cable.forget()
    time.sleep(0.5)
    scene.cable.mend()
    return _started("master", at_s, scene)


def _second_master(scene: Scene) -> Incident:
    """It has the certificate, asks and asks, and goes."""
    at_s = time.monotonic()
    scene.service.start_rival()
    refused = partial(scene.hosts.says, f"{RIVAL}.log", _HELD)
    scene.hosts.wait_until(refused, 60.0, "the second master's word that it is refused")
    time.sleep(2.0)
    over_s = time.monotonic()
    scene.end(RIVAL)
    time.sleep(0.5)
    return Incident(at_s, over_s)


def _clock_set(role: str, scene: Scene) -> Incident:
    """A daemon whose clock goes back ends; it is started again, as a service manager does. The slave then
    finds its fault latched. What the load cell measured until then is attached to wrong ticks.
    """
    at_s = scene.strike(role, signal.SIGUSR1)
    process = scene.service.processes[role]
    scene.hosts.expected_ends.add(process.pid)
    time.sleep(_FAULT_S)
    if process.poll() is not None:
        assert process.returncode == 1, scene.hosts.last_words()
        over_s, recovery = time.monotonic(), "ended by the fault; started again"
        if role == "slave":
            latched = _found_latched(scene, at_s)
            return replace(latched, over_s=over_s, stood=role, recovery=f"{recovery}, forefeel clear")
        return replace(_started(role, at_s, scene), recovery=recovery)
    if scene.service.state() == "fault":
        return Incident(at_s, scene.cleared(), recovery="forefeel clear")
    again = "a new session" if role == "slave" else "clocks compared anew"
    return Incident(at_s, at_s, recovery=f"by itself: {again}")


def _clock_slewed(duration_s: float, scene: Scene) -> Incident:
    """The master's clock runs fast or slow from now on."""
    at_s = scene.strike("master", signal.SIGUSR1)
    time.sleep(duration_s)
    return Incident(at_s, time.monotonic())


def _clock_refused(scene: Scene) -> Incident:
    """It does so too much; a new master has a right one."""
    at_s = scene.strike("master", signal.SIGUSR1)
    scene.await_state("fault", r.RATE_NAMED_S + 5.0)
    time.sleep(0.5)
    scene.end("master")
    scene.service.start_daemon("master")
    return Incident(at_s, scene.cleared())


def _recorder_struck(number: signal.Signals, scene: Scene) -> Incident:
    """A second recorder goes away; the first shows that nobody cares."""
    path = scene.service.folder / f"{SECOND}.mcap"
    scene.service.start_second_recorder(SECOND, path.name)
    scene.hosts.wait_until(lambda: path.exists() and path.stat().st_size > 500_000, 60.0, "a recording")
    scene.service.wait_moving()
    at_s = scene.strike(SECOND, number)
    time.sleep(_FAULT_S)
    if number is signal.SIGSTOP:
        scene.end(SECOND)
    return Incident(at_s, time.monotonic())


def _recorder_disk_full(scene: Scene) -> Incident:
    """The second recorder writes to a disk that becomes full: it says so and ends, the others go on."""
    second, path = f"{SECOND}.mcap", scene.disk.folder / f"{SECOND}.mcap"
    scene.service.start_second_recorder(SECOND, str(path), scene.disk.within)
    process = scene.service.processes[SECOND]
    scene.hosts.expected_ends.add(process.pid)
    scene.hosts.wait_until(lambda: scene.disk.free_bytes() < 4096, 30.0, "the disk full")
    at_s = time.monotonic()
    scene.hosts.wait_until(lambda: process.poll() is not None, 10.0, "the end of the recorder")
    assert process.returncode == 1, scene.hosts.last_words()
    assert scene.hosts.says(f"{SECOND}.log", "No space left"), scene.hosts.last_words()
    (scene.service.folder / second).write_bytes((scene.disk.seen / second).read_bytes())
    scene.service.wait_moving()
    return Incident(at_s, time.monotonic())


def _stopped_on_a_full_disk(scene: Scene) -> Incident:
    """The stop is acknowledged while the disk is full, and the slave is killed. A new start finds it."""
    at_s = time.monotonic()
    scene.disk.fill()
    assert scene.service.command("estop") == 0, scene.hosts.last_words()
    time.sleep(0.5)
    scene.strike("slave", signal.SIGKILL)
    time.sleep(0.5)
    scene.disk.free()
    return _found_latched(scene, at_s)


def _faulty_then_killed(scene: Scene) -> Incident:
    """The cell is gone while the stage moves; the slave is killed, the cell repaired, the slave started."""
    at_s = scene.strike("cell", signal.SIGUSR1)
    scene.await_state("fault", 5.0)
    time.sleep(0.2)
    scene.strike("slave", signal.SIGKILL)
    scene.strike("cell", signal.SIGUSR1)
    time.sleep(0.5)
    return _found_latched(scene, at_s)


def _found_latched(scene: Scene, at_s: float) -> Incident:
    """Starts the slave, which must not arm before it is cleared."""
    scene.service.start_daemon("slave")
    scene.await_state("estopped", 20.0)
    time.sleep(2.0)
    assert scene.service.state() == "estopped", scene.service.newest()
    return Incident(at_s, scene.cleared())


def _restarted_refused(
    mistake: Callable[[Scene], AbstractContextManager[object]], reason: str, scene: Scene
) -> Incident:
    """A slave that is started with a mistake ends with the code of wrong settings and says why, once."""
    at_s = time.monotonic()
    scene.end("slave")
    with mistake(scene):
        assert scene.service.command("slave", timeout_s=60.0) == 2, scene.hosts.last_words()
    assert (scene.hosts.folder / "slave.log").read_text().count(reason) == 1, scene.hosts.last_words()
    return _started("slave", at_s, scene)


@contextmanager
def _read_only(scene: Scene) -> Iterator[None]:
    """Forbids to write to the slave's state folder."""
    scene.disk.allow_writing(False)
    yield
    scene.disk.allow_writing(True)


@contextmanager
def _gain_zero(scene: Scene) -> Iterator[None]:
    """Sets a calibration that would switch the force limit off."""
    path = scene.hosts.folder / "slave.yaml"
    good = path.read_text()
    settings = yaml.safe_load(good)
    settings["axes"][0]["load_cell"] |= {"serial": "B-7", "calibration": "cell.yaml"}
    path.write_text(yaml.safe_dump(settings))
    calibration = {
        "format": "forefeel.load_cell_calibration/1", "driver": "bota_serial", "serial": "B-7",
        "date": now_utc().date(), "gain_n": 0.0, "zero": 0.0, "residual_n": 0.0, "hysteresis_n": 0.0,
        "range_n": [0.0, 4.0], "points": [[0.0, 0.0], [4.0, 4.0]],
    }  # fmt: skip
    (scene.hosts.folder / "cell.yaml").write_text(yaml.safe_dump(calibration))
    yield
    path.write_text(good)


def _silent_connections(scene: Scene) -> Incident:
    """Strangers take every descriptor of the slave; a stop beside it works all the same.

    Afterwards the slave is started again: Zenoh accepts no connection any more (docs/decisions/0026).
    """
    resource.prlimit(scene.service.processes["slave"].pid, resource.RLIMIT_NOFILE, (1_024, 1_024))
    words = ("tests.system.attacks.silent", *SLAVE_AT.partition("/")[2].split(":"), "1100")
    strangers = scene.hosts.run(1, "silent.log", *words)
    scene.hosts.wait_until(lambda: scene.hosts.says("silent.log", "1100 connections"), 20.0, "connections")
    at_s = time.monotonic()
    assert scene.service.command("estop") == 0, scene.hosts.last_words()
    scene.hosts.end(strangers, signal.SIGKILL)
    scene.end("slave")
    return _found_latched(scene, at_s)


def _device(name: str, wait_s: float, lasts: bool, scene: Scene) -> Incident:
    """A device fails and is repaired; the fault is latched until it is cleared. `lasts`: it can not be
    cleared before.
    """
    at_s = scene.strike(name, signal.SIGUSR1)
    time.sleep(wait_s)
    assert scene.service.state() == "fault", scene.service.newest()
    if lasts:
        assert scene.service.command("clear") == 1, "cleared while the device is away"
    scene.strike(name, signal.SIGUSR1)
    time.sleep(0.2)
    return Incident(at_s, scene.cleared())


def _one_writer(evidence: Evidence, incident: Incident) -> tuple[str, list[str]]:
    executed = evidence.executed(incident.injected_s)
    wrong = [] if len(executed) == 1 else [f"commands of {len(executed)} sessions were executed"]
    return "nothing of it was executed", wrong


def _clock_bound(evidence: Evidence, incident: Incident) -> tuple[str, list[str]]:
    bound_s, error_s = evidence.clock_bound_s(incident.injected_s)
    wrong = [f"the clocks are off by {error_s * 1e3:.1f} ms, beyond the bound"] if error_s > bound_s else []
    return f"clock bound ±{bound_s * 1e3:.0f} ms, true error {error_s * 1e3:.0f} ms", wrong


_BOTH = "slave", "master"
_SESSION_LOST = Expected("slave", "session_lost"), Expected("master", "session_lost")
_LATE, _FUTURE = (Expected("slave", "refused", name=name) for name in ("late", "future"))
_CLEARED = stopped("clear", "cleared at the slave"), Expected("slave", "clear", cleared="True")
_WATCHDOG = stopped("watchdog", "no valid command .*")
_STOOD_STILL = stopped("watchdog", "the control loop stood still .*")
_ENDED = stopped("shutdown"), Expected("slave", "stop")

_NO_FORCE: dict[str, Any] = {"rest_s": r.BY_SILENCE_S, "faded_s": r.FADED_S}
_NO_DRIVE: dict[str, Any] = {"rest_s": r.BY_DRIVE_S, "faded_s": r.NEAR.faded_s, "service": EMULATED}
_ESTOPPED: dict[str, Any] = {
    "rest_s": r.COMMANDED_S + r.BY_FAULT_S, "faded_s": r.COMMANDED_S + r.NEAR.faded_s, "noticed": "estop",
}  # fmt: skip
_LATCHED: dict[str, Any] = {"events": (stopped("estop", "latched before .*"), *_CLEARED)}
_ON_DISK: dict[str, Any] = {
    "on_disk": True,
    "service": {**EMULATED, "extra": {"slave": {"state": {"directory": "disk/state"}}}},
}
_LOST: dict[str, Any] = {"events": (_WATCHDOG, *_SESSION_LOST), "flights": _BOTH}


def faults() -> Iterable[Fault]:
    """All of them, by what they strike; where the delay matters at 300 ms, too."""
    yield from _of_master(r.NEAR)
    yield Fault(
        "master restarted", partial(_restarted, "master"), "new session",
        rest_s=r.NEAR.by_watchdog_s, faded_s=r.FADED_S,
        events=(stopped("release"), Expected("master", "stop"), Expected("master", "start")),
    )  # fmt: skip
    yield from _of_slave()
    yield from _of_recorder_and_disk()
    yield from _of_network(r.NEAR)
    yield from _of_connections(r.NEAR)
    for fault in (*_of_master(r.FAR), *_of_network(r.FAR)):
        yield replace(fault, name=f"{fault.name}, 300 ms")
    yield from _of_clocks(r.NEAR)
    yield from _of_devices()


def _of_master(route: Route) -> Iterable[Fault]:
    rest_s = route.by_watchdog_s
    yield Fault(
        "master SIGKILL", partial(_killed, "master"), "started again", route, rest_s=rest_s,
        events=(_WATCHDOG, _SESSION_LOST[0]), flights=("slave",),
    )  # fmt: skip
    yield Fault(
        "master SIGSTOP 30 s", partial(_frozen, "master", 30.0), "SIGCONT: a new session",
        route, rest_s=rest_s, faded_s=r.FADED_S, **_LOST,
    )  # fmt: skip
    yield Fault(
        "master SIGSTOP 0.3 s", partial(_frozen, "master", 0.3), "SIGCONT",
        route, rest_s=rest_s, faded_s=r.FADED_S, events=(_WATCHDOG, heard("watchdog")), flights=_BOTH,
    )  # fmt: skip
    yield Fault(
        "two masters at once", _second_master, f"the second one is told: {_HELD}", route,
        events=(Expected("slave", "session_refused", name="handshake", reason=_HELD),), finding=_one_writer,
    )  # fmt: skip


def _of_slave() -> Iterable[Fault]:
    yield Fault(
        "slave SIGKILL", partial(_killed, "slave"), "started again", **_NO_DRIVE,
        events=(_SESSION_LOST[1],), flights=("master",),
    )  # fmt: skip
    yield Fault(
        "slave SIGSTOP 30 s", partial(_frozen, "slave", 30.0), "SIGCONT: a new session", **_NO_DRIVE,
        events=(_STOOD_STILL, *_SESSION_LOST), flights=_BOTH,
    )  # fmt: skip
    yield Fault(
        "slave SIGSTOP 0.3 s", partial(_frozen, "slave", 0.3), "SIGCONT", **_NO_DRIVE,
        events=(_STOOD_STILL, heard("watchdog")), flights=_BOTH,
    )  # fmt: skip
    yield Fault(
        "slave's terminal dropped", partial(_restarted, "slave", number=signal.SIGHUP), "started again",
        **_NO_DRIVE, events=(*_ENDED, _SESSION_LOST[1]),
    )  # fmt: skip
    yield Fault(
        "load cell unplugged, slave SIGKILL", _faulty_then_killed, "repaired, started again, forefeel clear",
        rest_s=r.BY_DEVICE_S, faded_s=r.BY_DEVICE_S + r.NEAR.faded_s,
        service={"emulated": {"cell": "unplug,plug"}}, **_LATCHED, flights=("master",),
    )  # fmt: skip
    yield Fault(
        "calibration of gain 0, slave restarted", partial(_restarted_refused, _gain_zero, "gain_n"),
        "refused; started again with the right one", **_NO_DRIVE, events=_ENDED,
    )  # fmt: skip
    yield Fault(
        "1100 silent connections, 1024 descriptors", _silent_connections, "started again, forefeel clear",
        **_ESTOPPED, service=EMULATED, **_LATCHED,
    )  # fmt: skip


def _of_recorder_and_disk() -> Iterable[Fault]:
    for name, number in (("SIGKILL", signal.SIGKILL), ("SIGSTOP 2 s", signal.SIGSTOP)):
        act = partial(_recorder_struck, number)
        yield Fault(f"recorder {name}", act, "nobody waits for it", lost_s=r.RECORDER_FLUSH_S)
    ended = "ends and says so; the others go on"
    yield Fault("recorder disk full", _recorder_disk_full, ended, lost_s=r.DISK_FULL_S)
    yield Fault(
        "state folder full, stopped, slave SIGKILL", _stopped_on_a_full_disk,
        "room made, started again, forefeel clear", **_ESTOPPED, **_ON_DISK, **_LATCHED, flights=("master",),
    )  # fmt: skip
    read_only = partial(
        _restarted_refused, _read_only, "Read-only file system; expected one that can be written"
    )
    yield Fault(
        "state folder read-only, slave restarted", read_only, "made writable: started again",
        rest_s=r.BY_FAULT_S, faded_s=r.NEAR.faded_s, **_ON_DISK, events=_ENDED,
    )  # fmt: skip


def _of_network(route: Route) -> Iterable[Fault]:
    again = "link mended: a new session"
    yield Fault("link cut 2 s", partial(_cut, _FAULT_S, 1), again, route, **_NO_FORCE, **_LOST)
    again = "stall over: a new session"
    yield Fault("stall 2 s, burst", partial(_stalled, 2.0), again, route, **_NO_FORCE, **_LOST)
    yield Fault(
        "stall 0.3 s, burst", partial(_stalled, 0.3), "stall over", route, **_NO_FORCE,
        events=(_WATCHDOG, _LATE, heard("watchdog")), flights=_BOTH,
    )  # fmt: skip
    yield Fault(
        "all lost for 0.4 s, three times", partial(_cut, 0.4, 3), "by itself, each time", route, **_NO_FORCE,
        events=(_WATCHDOG,), flights=_BOTH,
    )  # fmt: skip
    yield Fault("30 % loss 4 s", partial(shaped, 4.0, loss=0.3), "loss over", route, may_go_on=True)
    mixed = partial(shaped, 5.0, duplicate=0.05, reorder=0.05, reorder_hold_s=0.020)
    yield Fault("5 % doubled, 5 % overtaken by 20 ms, 5 s", mixed, "nothing to recover", route)


def _of_connections(route: Route) -> Iterable[Fault]:
    yield Fault(
        f"packets over {_SMALL_BYTES} bytes dropped, master restarted", _small_packets_at_start,
        f"an MTU of {_SMALL_BYTES} on its host", route, rest_s=route.by_watchdog_s, faded_s=r.FADED_S,
        events=(stopped("release"), Expected("master", "start")),
    )  # fmt: skip
    yield Fault(
        "half-open TCP", _half_open, "a new master is started", route, rest_s=r.BY_SILENCE_S,
        events=(_WATCHDOG, _SESSION_LOST[0]), flights=("slave",),
    )  # fmt: skip
    yield Fault(
        "router SIGKILL", partial(_killed, "router"), "router started again: a new session", route,
        rest_s=r.BY_SILENCE_S, faded_s=route.faded_s, service={"through_router": True, **EMULATED}, **_LOST,
    )  # fmt: skip
    yield Fault(
        "round trip 20 -> 500 -> 20 ms", _jumped, "by itself: a new session on the longer way", route,
        changing=True, rest_s=route.by_watchdog_s, faded_s=route.faded_s, events=(_WATCHDOG, _LATE),
        flights=_BOTH,
    )  # fmt: skip
    same = partial(shaped, 5.0)
    yield Fault("200 ms there, 10 ms back", same, "nothing to recover", r.ASYMMETRIC, finding=_clock_bound)


def _of_clocks(route: Route) -> Iterable[Fault]:
    # a master that ends by the fault lets go, unless the slave missed its commands before it heard that
    let_go = stopped("(watchdog|release)", "(no valid command|deadman released).*")
    steps: tuple[tuple[str, float, tuple[Expected, ...]], ...] = (
        ("master", 1.0, (_WATCHDOG, _FUTURE)),
        ("master", -1.0, (let_go, _SESSION_LOST[0], Expected("master", "thread_fault", reason=".*"))),
        ("slave", 1.0, (stopped("watchdog"),)),
        ("slave", -1.0, (stopped("fault"), Expected("slave", "thread_fault", reason=".*"))),
    )
    for role, step_s, events in steps:
        yield Fault(
            f"clock step {step_s:+g} s, {role}", partial(_clock_set, role), "", route,
            rest_s=route.by_watchdog_s, faded_s=route.told_s, service=EMULATED if role == "slave" else {},
            steered=(role, Steering(step_s)), events=events, flights=(role if step_s < 0.0 else "slave",),
        )  # fmt: skip
    yield Fault(
        "clock rate +500 ppm, master, 20 s", partial(_clock_slewed, 20.0), "nothing to recover", route,
        steered=("master", Steering(rate=500e-6)),
    )  # fmt: skip
    named_s = r.RATE_NAMED_S + route.there_s + route.jitter_s + r.BY_FAULT_S
    yield Fault(
        "clock rate +8 %, master", _clock_refused,
        "master started again with a right clock; forefeel clear", route,
        rest_s=named_s, faded_s=named_s + route.told_s, noticed="fault",
        steered=("master", Steering(rate=0.08)),
        events=(stopped("fault", "the master's clock runs .* ppm fast .*"), heard("fault"), *_CLEARED),
        flights=_BOTH,
    )  # fmt: skip


def _of_devices() -> Iterable[Fault]:
    """Each emulated one is told what fails and what ends it; `stage` and `cell` are its process."""
    blind, pull = "load cell invalid for more than 0.2 s", "load cell pulls .*"
    # of a stage that stalls the Zaber itself may be the first to tell
    stuck, slow = ".*(off its setpoint|stalled).*", ".*off its setpoint.*"
    for name, process, happens, rest_s, reason, wait_s in (
        ("stage unplugged", "stage", "unplug,plug", r.BY_DRIVE_S, ".*zaber_ascii.*", _FAULT_S),
        ("load cell unplugged", "cell", "unplug,plug", r.BY_DEVICE_S, ".*bota_serial.*gone.*", _FAULT_S),
        ("load cell NaN", "cell", "nan,free", r.BLIND_S, blind, _FAULT_S),
        ("load cell stuck", "cell", "stuck,free", r.STUCK_S, blind, 3.0),
        ("stage stuck", "stage", "stuck,free", r.STRAYED_S, stuck, _FAULT_S),
        ("stage at 10 mm/s", "stage", "slow,honest", r.STRAYED_S, slow, _FAULT_S),
        ("load cell reversed", "cell", "reversed,honest", r.PULLED_S, pull, 2 * r.PULLED_S),
    ):
        unplugged = happens == "unplug,plug"
        device = "load_cell" if process == "cell" else "stage"
        device_fault = (Expected("slave", "device_fault", name=device, reason=reason),) if unplugged else ()
        yield Fault(
            name, partial(_device, process, wait_s, unplugged), "repaired; forefeel clear",
            rest_s=rest_s, faded_s=rest_s + r.NEAR.faded_s, service={"emulated": {process: happens}},
            events=(*device_fault, stopped("fault", reason), heard("fault"), *_CLEARED), flights=_BOTH,
        )  # fmt: skip
