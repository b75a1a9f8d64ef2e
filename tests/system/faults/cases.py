"""The faults."""

import resource
import signal
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from typing import Any

import yaml

from forefeel.common.clock import now_utc
from tests.system.faults import required as r
from tests.system.faults.logged import Expected, heard, says, stopped
from tests.system.faults.required import Route
from tests.system.faults.scene import SECOND, Fault, Incident, Scene
from tests.system.net.evidence import Evidence
from tests.system.net.namespaces import ip
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
    speed_m_s = scene.service.wait_moving()
    at_s = scene.strike(role, signal.SIGKILL)
    time.sleep(_FAULT_S)
    over_s = time.monotonic()
    _start(role, scene)
    scene.rearmed()
    return Incident(at_s, over_s, speed_m_s, gone=role == "master")


def _restarted(role: str, scene: Scene, number: signal.Signals = signal.SIGTERM) -> Incident:
    """SIGTERM, as a service manager does, or SIGHUP, as a terminal that goes; a new process and session."""
    speed_m_s = scene.service.wait_moving()
    at_s = time.monotonic()
    assert scene.hosts.end(scene.service.processes[role], number) == 0, scene.hosts.last_words()
    over_s = time.monotonic()
    _start(role, scene)
    scene.rearmed()
    return Incident(at_s, over_s, speed_m_s)


def _start(role: str, scene: Scene) -> None:
    if role == "slave":
        scene.service.start_slave()
    else:
        scene.service.start_master()


def _frozen(role: str, frozen_s: float, scene: Scene) -> Incident:
    """SIGSTOP, and SIGCONT."""
    speed_m_s = scene.service.wait_moving()
    at_s = scene.strike(role, signal.SIGSTOP)
    time.sleep(frozen_s)
    over_s = scene.strike(role, signal.SIGCONT)
    time.sleep(0.5)
    scene.rearmed()
    return Incident(at_s, over_s, speed_m_s, frozen=role == "master", stood=role == "slave")


def _cut(scene: Scene) -> Incident:
    speed_m_s = scene.service.wait_moving()
    at_s = scene.cable.cut() * _NS
    time.sleep(_FAULT_S)
    over_s = scene.cable.mend() * _NS
    scene.rearmed()
    return Incident(at_s, over_s, speed_m_s)


def stalled(stall_s: float, scene: Scene) -> Incident:
    """Everything is held, then comes in one burst: old commands to the slave, old forces to the master."""
    speed_m_s = scene.service.wait_moving()
    at_s = scene.cable.stall(stall_s) * _NS
    time.sleep(stall_s + 0.5)
    scene.rearmed()
    return Incident(at_s, at_s + stall_s, speed_m_s)


def _shaped(duration_s: float, scene: Scene, **more: Any) -> Incident:  # noqa: ANN401
    """The cable does that for a while, beside its usual delays; what runs above retransmits."""
    speed_m_s = scene.service.wait_moving()
    at_s = scene.shape(**more)
    time.sleep(duration_s)
    over_s = scene.shape()
    scene.rearmed()
    return Incident(at_s, over_s, speed_m_s)


def _small_packets_at_start(scene: Scene) -> Incident:
    """The handshake of TLS does not pass. The cable stays so; the MTU of one host's device is the cure, which
    bounds the segments of both.
    """
    speed_m_s = scene.service.wait_moving()
    at_s, unanswered = time.monotonic(), scene.said("master", _NO_ANSWER)
    assert scene.hosts.end(scene.service.processes["master"]) == 0, scene.hosts.last_words()
    scene.shape(largest_bytes=_SMALL_BYTES)
    _start("master", scene)
    scene.hosts.wait_until(lambda: scene.said("master", _NO_ANSWER) > unanswered, 20.0, _NO_ANSWER)
    assert scene.service.state() == "idle", scene.service.seen()
    master = scene.hosts.names[1]
    ip("-n", master, "link", "set", master, "mtu", str(_SMALL_BYTES))
    over_s = time.monotonic()
    scene.rearmed()
    return Incident(at_s, over_s, speed_m_s)


def _jumped(scene: Scene) -> Incident:
    """The way becomes longer for some seconds, but less than where the slave would not arm."""
    speed_m_s = scene.service.wait_moving()
    at_s = scene.shape(r.SLOW)
    for stay_s in (2.0, 0.0):
        time.sleep(1.0)
        scene.rearmed()
        time.sleep(stay_s)
        scene.shape()
    return Incident(at_s, at_s, speed_m_s)


def _bursts(scene: Scene) -> Incident:
    """All packets are lost for 400 ms, three times."""
    speed_m_s = scene.service.wait_moving()
    begun_s, over_s = list[float](), 0.0
    for _ in range(3):
        begun_s.append(scene.cable.cut() * _NS)
        time.sleep(0.4)
        over_s = scene.cable.mend() * _NS
        time.sleep(1.6)
    scene.rearmed()
    return Incident(begun_s[0], over_s, speed_m_s, again_s=tuple(begun_s[1:]))


def _half_open(scene: Scene) -> Incident:
    """The master dies while the cable is cut; its connections never end for the slave."""
    speed_m_s = scene.service.wait_moving()
    at_s = scene.cable.cut() * _NS
    scene.strike("master", signal.SIGKILL)
    scene.cable.forget()
    time.sleep(0.5)
    over_s = scene.cable.mend() * _NS
    scene.service.start_master()
    scene.rearmed()
    return Incident(at_s, over_s, speed_m_s, gone=True)


def _as_it_is(duration_s: float, scene: Scene) -> Incident:
    """Nothing happens but what the usual cable does."""
    speed_m_s = scene.service.wait_moving()
    at_s = time.monotonic()
    time.sleep(duration_s)
    return Incident(at_s, time.monotonic(), speed_m_s)


def _second_master(scene: Scene) -> Incident:
    """It has the certificate, asks and asks, and goes."""
    speed_m_s = scene.service.wait_moving()
    at_s = time.monotonic()
    scene.service.start_rival()
    refused = partial(scene.hosts.says, f"{RIVAL}.log", _HELD)
    scene.hosts.wait_until(refused, 60.0, "the second master's word that it is refused")
    time.sleep(2.0)
    over_s = time.monotonic()
    assert scene.hosts.end(scene.service.processes[RIVAL]) == 0, scene.hosts.last_words()
    time.sleep(0.5)
    return Incident(at_s, over_s, speed_m_s)


def _router_killed(scene: Scene) -> Incident:
    speed_m_s = scene.service.wait_moving()
    at_s = scene.strike("router", signal.SIGKILL)
    time.sleep(_FAULT_S)
    over_s = time.monotonic()
    scene.service.start_router()
    scene.rearmed()
    return Incident(at_s, over_s, speed_m_s)


def _clock_set(role: str, scene: Scene) -> Incident:
    """A daemon whose clock goes back ends; it is started again, as a service manager does. The slave then
    finds its fault latched. What the load cell measured until then is attached to wrong ticks.
    """
    speed_m_s = scene.service.wait_moving()
    at_s = scene.strike(role, signal.SIGUSR1)
    process = scene.service.processes[role]
    scene.hosts.expected_ends.add(process.pid)
    time.sleep(_FAULT_S)
    over_s = at_s
    recovery = f"by itself: {'a new session' if role == 'slave' else 'clocks compared anew'}"
    if process.poll() is not None:
        assert process.returncode == 1, scene.hosts.last_words()
        over_s, recovery = time.monotonic(), "ended by the fault; started again"
        if role == "slave":
            found = _found_latched(scene, at_s, speed_m_s)
            return replace(found, over_s=over_s, stood=True, recovery=f"{recovery}, forefeel clear")
        _start(role, scene)
    elif scene.service.state() == "fault":
        over_s, recovery = scene.cleared(), "forefeel clear"
    scene.rearmed()
    return Incident(at_s, over_s, speed_m_s, recovery=recovery)


def _clock_slewed(duration_s: float, scene: Scene) -> Incident:
    """The master's clock runs fast or slow from now on."""
    speed_m_s = scene.service.wait_moving()
    at_s = scene.strike("master", signal.SIGUSR1)
    time.sleep(duration_s)
    return Incident(at_s, time.monotonic(), speed_m_s)


def _clock_refused(scene: Scene) -> Incident:
    """It does so too much; a new master has a right one."""
    speed_m_s = scene.service.wait_moving()
    at_s = scene.strike("master", signal.SIGUSR1)
    scene.hosts.wait_until(lambda: scene.service.state() == "fault", r.RATE_NAMED_S + 5.0, "a fault")
    time.sleep(0.5)
    assert scene.hosts.end(scene.service.processes["master"]) == 0, scene.hosts.last_words()
    scene.service.start_master()
    over_s = scene.cleared()
    scene.rearmed()
    return Incident(at_s, over_s, speed_m_s)


def _recorder_struck(number: signal.Signals, scene: Scene) -> Incident:
    """A second recorder goes away; the first shows that nobody cares."""
    path = scene.service.folder / f"{SECOND}.mcap"
    scene.service.start_second_recorder(SECOND, path.name)
    scene.hosts.wait_until(lambda: path.exists() and path.stat().st_size > 500_000, 60.0, "a recording")
    speed_m_s = scene.service.wait_moving()
    at_s = scene.strike(SECOND, number)
    time.sleep(_FAULT_S)
    if number is signal.SIGSTOP:
        assert scene.hosts.end(scene.service.processes[SECOND]) == 0
    time.sleep(1.0)
    return Incident(at_s, time.monotonic(), speed_m_s)


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
    speed_m_s = scene.service.wait_moving()
    time.sleep(1.0)
    return Incident(at_s, time.monotonic(), speed_m_s)


def _stopped_on_a_full_disk(scene: Scene) -> Incident:
    """The stop is acknowledged while the disk is full, and the slave is killed. A new start finds it."""
    speed_m_s = scene.service.wait_moving()
    at_s = time.monotonic()
    scene.disk.fill()
    assert scene.service.stop() == 0, scene.hosts.last_words()
    time.sleep(0.5)
    scene.strike("slave", signal.SIGKILL)
    time.sleep(0.5)
    scene.disk.free()
    return _found_latched(scene, at_s, speed_m_s)


def _faulty_then_killed(scene: Scene) -> Incident:
    """The cell is gone while the stage moves; the slave is killed, the cell repaired, the slave started."""
    speed_m_s = scene.service.wait_moving()
    at_s = scene.strike("cell", signal.SIGUSR1)
    scene.hosts.wait_until(lambda: scene.service.state() == "fault", 5.0, "a fault")
    time.sleep(0.2)
    scene.strike("slave", signal.SIGKILL)
    scene.strike("cell", signal.SIGUSR1)
    time.sleep(0.5)
    return _found_latched(scene, at_s, speed_m_s)


def _found_latched(scene: Scene, at_s: float, speed_m_s: float) -> Incident:
    """Starts the slave, which must not arm before it is cleared."""
    _start("slave", scene)
    scene.hosts.wait_until(lambda: scene.service.state() == "estopped", 20.0, "a latched stop")
    time.sleep(2.0)
    assert scene.service.state() == "estopped", scene.service.seen()
    over_s = scene.cleared()
    scene.rearmed()
    return Incident(at_s, over_s, speed_m_s)


def _read_only(scene: Scene) -> Incident:
    """A slave whose state folder can not be written to does not start, and says so."""
    speed_m_s = scene.service.wait_moving()
    at_s = time.monotonic()
    assert scene.hosts.end(scene.service.processes["slave"]) == 0, scene.hosts.last_words()
    scene.disk.allow_writing(False)
    _refused_start(scene)
    assert scene.said("slave", "Read-only file system; expected one that can be written") == 1
    scene.disk.allow_writing(True)
    over_s = time.monotonic()
    _start("slave", scene)
    scene.rearmed()
    return Incident(at_s, over_s, speed_m_s)


def _refused_start(scene: Scene) -> None:
    """The slave with the settings as they are now ends with the code of wrong settings."""
    words = ("forefeel", "slave", "--config", "slave.yaml")
    refused = scene.hosts.run(0, "slave.log", *words, within=scene.service.within.get("slave", ()))
    scene.hosts.expected_ends.add(refused.pid)
    assert refused.wait(60) == 2, scene.hosts.last_words()


def _gain_zero(scene: Scene) -> Incident:
    """A calibration that would switch the force limit off: the slave does not start with it."""
    speed_m_s = scene.service.wait_moving()
    at_s = time.monotonic()
    assert scene.hosts.end(scene.service.processes["slave"]) == 0, scene.hosts.last_words()
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
    _refused_start(scene)
    assert scene.said("slave", "gain_n") == 1, scene.hosts.last_words()
    path.write_text(good)
    over_s = time.monotonic()
    _start("slave", scene)
    scene.rearmed()
    return Incident(at_s, over_s, speed_m_s)


def _silent_connections(scene: Scene) -> Incident:
    """Strangers take every descriptor of the slave; a stop beside it works all the same.

    Afterwards the slave is started again: Zenoh accepts no connection any more (docs/decisions/0026).
    """
    slave = scene.service.processes["slave"]
    speed_m_s = scene.service.wait_moving()
    resource.prlimit(slave.pid, resource.RLIMIT_NOFILE, (1_024, 1_024))
    words = ("tests.system.attacks.silent", *SLAVE_AT.partition("/")[2].split(":"), "1100")
    strangers = scene.hosts.run(1, "silent.log", *words)
    scene.hosts.wait_until(lambda: scene.hosts.says("silent.log", "1100 connections"), 20.0, "connections")
    at_s = time.monotonic()
    assert scene.service.stop() == 0, scene.hosts.last_words()
    scene.hosts.expected_ends.add(strangers.pid)
    strangers.kill()
    assert scene.hosts.end(slave) == 0, scene.hosts.last_words()
    return _found_latched(scene, at_s, speed_m_s)


def _device(name: str, wait_s: float, lasts: bool, scene: Scene) -> Incident:
    """A device fails and is repaired; the fault is latched until it is cleared. `lasts`: it can not be
    cleared before.
    """
    speed_m_s = scene.service.wait_moving()
    at_s = scene.strike(name, signal.SIGUSR1)
    time.sleep(wait_s)
    assert scene.service.state() == "fault", scene.service.seen()
    if lasts:
        assert scene.service.clear() == 1, "cleared while the device is away"
    scene.strike(name, signal.SIGUSR1)
    time.sleep(0.2)
    over_s = scene.cleared()
    scene.rearmed()
    return Incident(at_s, over_s, speed_m_s)


def _one_writer(found: Evidence, incident: Incident) -> tuple[str, list[str]]:
    executed = found.executed(incident.injected_s)
    wrong = [] if len(executed) == 1 else [f"commands of {len(executed)} sessions were executed"]
    return "nothing of it was executed", wrong


def _clock_bound(found: Evidence, incident: Incident) -> tuple[str, list[str]]:
    bound_s, error_s = found.clock_bound_s(incident.injected_s)
    wrong = [f"the clocks are off by {error_s * 1e3:.1f} ms, beyond the bound"] if error_s > bound_s else []
    return f"clock bound ±{bound_s * 1e3:.0f} ms, true error {error_s * 1e3:.0f} ms", wrong


_SESSION_LOST = says("slave", "session_lost"), says("master", "session_lost")
_CLEARED = stopped("clear", "cleared at the slave"), says("slave", "clear", cleared="True")
_FOUND_LATCHED = stopped("estop", "latched before .*"), *_CLEARED
_WATCHDOG = stopped("watchdog", "no valid command .*")
_STOOD_STILL = stopped("watchdog", "the control loop stood still .*")
_LATE = says("slave", "refused", name="late")
_FUTURE = says("slave", "refused", name="future")
_BOTH = "slave", "master"


def _failed(reason: str, device: str = "") -> tuple[Expected, ...]:
    """A device's fault, latched and cleared."""
    named = (says("slave", "device_fault", name=device, reason=reason),) if device else ()
    return *named, stopped("fault", reason), heard("fault"), *_CLEARED


def _emulated(
    name: str,
    device: str,
    fault: str,
    rest_s: float,
    reason: str,
    wait_s: float = _FAULT_S,
    end: str = "free",
) -> Fault:
    """Of an emulated device; `stage` and `cell` are its process."""
    lasts = fault == "unplug"
    return Fault(
        name,
        partial(_device, device, wait_s, lasts),
        "repaired; forefeel clear",
        rest_s=rest_s,
        faded_s=rest_s + r.NEAR.faded_s,
        service={"emulated": {device: f"{fault},{'plug' if lasts else end}"}},
        events=_failed(reason, ({"cell": "load_cell"}.get(device, device)) if lasts else ""),
        flights=_BOTH,
    )


def _recorder(
    what: str, act: Callable[[Scene], Incident], recovery: str, lost_s: float = r.RECORDER_FLUSH_S
) -> Fault:
    return Fault(f"recorder {what}", act, recovery, lost_s=lost_s)


def _clock_step(role: str, step_s: float, route: Route) -> Fault:
    back = step_s < 0.0
    # a master that ends by the fault lets go, unless the slave missed its commands before it heard that
    first = stopped("(watchdog|release)", "(no valid command|deadman released).*") if back else _WATCHDOG
    events: tuple[Expected, ...] = (first, _SESSION_LOST[0] if back else _FUTURE)
    if role == "slave":
        events = (stopped("fault", ".*"),) if back else (stopped("watchdog"),)
    if back:
        events = *events, says(role, "thread_fault", reason=".*")
    return Fault(
        f"clock step {step_s:+g} s, {role}",
        partial(_clock_set, role),
        "",
        route,
        rest_s=route.by_watchdog_s,
        faded_s=route.told_s,
        service=EMULATED if role == "slave" else {},
        steered=(role, Steering(step_s)),
        events=events,
        flights=(role if back else "slave",),
    )


def _clock_rate(rate: float, route: Route) -> Fault:
    name = f"clock rate {rate * 100:+g} %, master"
    return Fault(
        name, _clock_refused, "master started again with a right clock; forefeel clear", route,
        rest_s=route.by_rate_s, faded_s=route.by_rate_s + route.told_s, noticed="fault",
        steered=("master", Steering(rate=rate)),
        events=_failed(f"the master's clock runs .* ppm {'fast' if rate > 0 else 'slow'} .*"), flights=_BOTH,
    )  # fmt: skip


def faults() -> Iterable[Fault]:
    """All of them, by what they strike; where the delay matters at 300 ms, too."""
    yield from _of_master(r.NEAR)
    yield Fault(
        "master restarted", partial(_restarted, "master"), "new session",
        rest_s=r.NEAR.by_watchdog_s, faded_s=r.FADED_S,
        events=(stopped("release"), says("master", "stop"), says("master", "start")),
    )  # fmt: skip
    yield from _of_slave()
    yield from _of_recorder_and_disk()
    yield from _of_network(r.NEAR)
    yield from _of_connections(r.NEAR)
    for fault in (*_of_master(r.FAR), *_of_network(r.FAR)):
        yield replace(fault, name=f"{fault.name}, 300 ms")
    yield from _of_routes()
    yield from _of_clocks()
    yield from _of_devices()


def _of_master(route: Route) -> Iterable[Fault]:
    yield Fault(
        "master SIGKILL", partial(_killed, "master"), "started again", route, rest_s=route.by_watchdog_s,
        events=(_WATCHDOG, _SESSION_LOST[0]), flights=("slave",),
    )  # fmt: skip
    yield Fault(
        "master SIGSTOP 30 s", partial(_frozen, "master", 30.0), "SIGCONT: a new session",
        route, rest_s=route.by_watchdog_s, faded_s=r.FADED_S,
        events=(_WATCHDOG, *_SESSION_LOST), flights=_BOTH,
    )  # fmt: skip
    yield Fault(
        "master SIGSTOP 0.3 s", partial(_frozen, "master", 0.3), "SIGCONT", route,
        rest_s=route.by_watchdog_s, faded_s=r.FADED_S,
        events=(_WATCHDOG, heard("watchdog")), flights=_BOTH,
    )  # fmt: skip
    yield Fault(
        "two masters at once", _second_master, f"the second one is told: {_HELD}", route,
        events=(says("slave", "session_refused", name="handshake", reason=_HELD),), finding=_one_writer,
    )  # fmt: skip


def _of_slave() -> Iterable[Fault]:
    yield Fault(
        "slave SIGKILL", partial(_killed, "slave"), "started again",
        rest_s=r.BY_DRIVE_S, faded_s=r.NEAR.faded_s, service=EMULATED,
        events=(_SESSION_LOST[1],), flights=("master",),
    )  # fmt: skip
    yield Fault(
        "slave SIGSTOP 30 s", partial(_frozen, "slave", 30.0), "SIGCONT: a new session",
        rest_s=r.BY_DRIVE_S, faded_s=r.NEAR.faded_s, service=EMULATED,
        events=(_STOOD_STILL, *_SESSION_LOST), flights=_BOTH,
    )  # fmt: skip
    yield Fault(
        "slave SIGSTOP 0.3 s", partial(_frozen, "slave", 0.3), "SIGCONT",
        rest_s=r.BY_DRIVE_S, faded_s=r.NEAR.faded_s, service=EMULATED,
        events=(_STOOD_STILL, heard("watchdog")), flights=_BOTH,
    )  # fmt: skip
    yield Fault(
        "slave's terminal dropped", partial(_restarted, "slave", number=signal.SIGHUP), "started again",
        rest_s=r.BY_DRIVE_S, faded_s=r.NEAR.faded_s, service=EMULATED,
        events=(stopped("shutdown"), says("slave", "stop"), _SESSION_LOST[1]),
    )  # fmt: skip
    yield Fault(
        "load cell unplugged, slave SIGKILL", _faulty_then_killed, "repaired, started again, forefeel clear",
        rest_s=r.BY_DEVICE_S, faded_s=r.BY_DEVICE_S + r.NEAR.faded_s,
        service={"emulated": {"cell": "unplug,plug"}},
        events=_FOUND_LATCHED,
        flights=("master",),
    )  # fmt: skip
    yield Fault(
        "calibration of gain 0, slave restarted", _gain_zero, "refused; started again with the right one",
        rest_s=r.BY_DRIVE_S, faded_s=r.NEAR.faded_s, service=EMULATED,
        events=(stopped("shutdown"), says("slave", "stop")),
    )  # fmt: skip
    yield Fault(
        "1100 silent connections, 1024 descriptors", _silent_connections, "started again, forefeel clear",
        rest_s=r.COMMANDED_S + r.BY_FAULT_S, faded_s=r.COMMANDED_S + r.NEAR.faded_s, noticed="estop",
        service=EMULATED, events=_FOUND_LATCHED,
    )  # fmt: skip


def _of_recorder_and_disk() -> Iterable[Fault]:
    yield _recorder("SIGKILL", partial(_recorder_struck, signal.SIGKILL), "nobody waits for it")
    yield _recorder("SIGSTOP 2 s", partial(_recorder_struck, signal.SIGSTOP), "nobody waits for it")
    yield _recorder("disk full", _recorder_disk_full, "ends and says so; the others go on", r.DISK_FULL_S)
    on_disk: dict[str, Any] = {**EMULATED, "extra": {"slave": {"state": {"directory": "disk/state"}}}}
    yield Fault(
        "state folder full, stopped, slave SIGKILL", _stopped_on_a_full_disk,
        "room made, started again, forefeel clear",
        rest_s=r.COMMANDED_S + r.BY_FAULT_S, faded_s=r.COMMANDED_S + r.NEAR.faded_s, noticed="estop",
        on_disk=True, service=on_disk,
        events=_FOUND_LATCHED,
        flights=("master",),
    )  # fmt: skip
    yield Fault(
        "state folder read-only, slave restarted", _read_only, "made writable: started again",
        rest_s=r.BY_FAULT_S, faded_s=r.NEAR.faded_s, on_disk=True, service=on_disk,
        events=(stopped("shutdown"), says("slave", "stop")),
    )  # fmt: skip


def _of_network(route: Route) -> Iterable[Fault]:
    yield Fault(
        "link cut 2 s", _cut, "link mended: a new session", route, rest_s=r.BY_SILENCE_S, faded_s=r.FADED_S,
        events=(_WATCHDOG, *_SESSION_LOST), flights=_BOTH,
    )  # fmt: skip
    yield Fault(
        "stall 2 s, burst", partial(stalled, 2.0), "stall over: a new session", route,
        rest_s=r.BY_SILENCE_S, faded_s=r.FADED_S, events=(_WATCHDOG, *_SESSION_LOST), flights=_BOTH,
    )  # fmt: skip
    yield Fault(
        "stall 0.3 s, burst", partial(stalled, 0.3), "stall over", route,
        rest_s=r.BY_SILENCE_S, faded_s=r.FADED_S,
        events=(_WATCHDOG, _LATE, heard("watchdog")), flights=_BOTH,
    )  # fmt: skip
    yield Fault(
        "all lost for 0.4 s, three times", _bursts, "by itself, each time", route,
        rest_s=r.BY_SILENCE_S, faded_s=r.FADED_S, events=(_WATCHDOG,), flights=_BOTH,
    )  # fmt: skip
    yield Fault("30 % loss 4 s", partial(_shaped, 4.0, loss=0.3), "loss over", route, may_go_on=True)
    mixed: dict[str, Any] = {"duplicate": 0.05, "reorder": 0.05, "reorder_hold_s": 0.020}
    yield Fault(
        "5 % doubled, 5 % overtaken by 20 ms, 5 s",
        partial(_shaped, 5.0, **mixed),
        "nothing to recover",
        route,
    )


def _of_connections(route: Route) -> Iterable[Fault]:
    yield Fault(
        f"packets over {_SMALL_BYTES} bytes dropped, master restarted", _small_packets_at_start,
        f"an MTU of {_SMALL_BYTES} on its host",
        route, rest_s=route.by_watchdog_s, faded_s=r.FADED_S,
        events=(stopped("release"), says("master", "start")),
    )  # fmt: skip
    yield Fault(
        "half-open TCP", _half_open, "a new master is started", route, rest_s=r.BY_SILENCE_S,
        events=(_WATCHDOG, _SESSION_LOST[0]), flights=("slave",),
    )  # fmt: skip
    yield Fault(
        "router SIGKILL", _router_killed, "router started again: a new session", route,
        rest_s=r.BY_SILENCE_S, faded_s=route.faded_s,
        service={"through_router": True, "emulated": {}},
        events=(_WATCHDOG, *_SESSION_LOST), flights=_BOTH,
    )  # fmt: skip


def _of_routes() -> Iterable[Fault]:
    yield Fault(
        "round trip 20 -> 500 -> 20 ms", _jumped, "by itself: a new session on the longer way",
        changing=True, rest_s=r.NEAR.by_watchdog_s, faded_s=r.NEAR.faded_s,
        events=(_WATCHDOG, _LATE), flights=_BOTH,
    )  # fmt: skip
    yield Fault(
        "200 ms there, 10 ms back", partial(_as_it_is, 5.0), "nothing to recover", r.ASYMMETRIC,
        finding=_clock_bound,
    )  # fmt: skip


def _of_clocks() -> Iterable[Fault]:
    for role in ("master", "slave"):
        yield from (_clock_step(role, step_s, r.NEAR) for step_s in (1.0, -1.0))
    yield Fault(
        "clock rate +500 ppm, master, 20 s", partial(_clock_slewed, 20.0), "nothing to recover",
        steered=("master", Steering(rate=500e-6)),
    )  # fmt: skip
    yield _clock_rate(0.08, r.NEAR)


def _of_devices() -> Iterable[Fault]:
    blind = "load cell invalid for more than 0.2 s"
    yield _emulated("stage unplugged", "stage", "unplug", r.BY_DRIVE_S, ".*zaber_ascii.*")
    yield _emulated("load cell unplugged", "cell", "unplug", r.BY_DEVICE_S, ".*bota_serial.*gone.*")
    yield _emulated("load cell NaN", "cell", "nan", r.BLIND_S, blind)
    yield _emulated("load cell stuck", "cell", "stuck", r.STUCK_S, blind, 3.0)
    # of a stage that stalls the Zaber itself may be the first to tell
    yield _emulated("stage stuck", "stage", "stuck", r.STRAYED_S, ".*(off its setpoint|stalled).*")
    slow = ".*off its setpoint.*"
    yield _emulated("stage at 10 mm/s", "stage", "slow", r.STRAYED_S, slow, end="honest")
    pull = "load cell pulls .*"
    yield _emulated("load cell reversed", "cell", "reversed", r.PULLED_S, pull, 2 * r.PULLED_S, end="honest")
